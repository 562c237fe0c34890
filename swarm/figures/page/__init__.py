"""The page: a population as one self-contained HTML file to play, scrub, zoom and ask."""

from swarm.figures.page.document import page, save_page

__all__ = ["page", "save_page"]
