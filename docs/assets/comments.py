"""For the API reference: the comment behind an attribute, with its shape and unit, is what is said of it."""

from __future__ import annotations

import io
import tokenize
from typing import Any

import griffe


class Comments(griffe.Extension):
    """Takes comments as docstrings of attributes that have none."""

    def on_attribute_instance(self, *, attr: griffe.Attribute, **kwargs: Any) -> None:
        """Called by Griffe for each attribute that it finds in a source file."""
        if attr.docstring or attr.lineno is None or not attr.parent.is_class:
            return
        source = "\n".join(attr.lines_collection[attr.filepath][attr.lineno - 1 : attr.endlineno]) + "\n"
        try:
            tokens = list(tokenize.generate_tokens(io.StringIO(source.lstrip()).readline))
        except (tokenize.TokenError, IndentationError):
            return
        words = [token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT]
        if words:
            # Square brackets hold units, not links.
            text = " ".join(words).replace("[", r"\[").replace("]", r"\]").replace("*", r"\*")
            attr.docstring = griffe.Docstring(text, parent=attr)
