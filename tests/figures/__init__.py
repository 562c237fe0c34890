"""What a user's matplotlibrc may hold, and no figure may take over."""

HOSTILE = {
    **dict.fromkeys(
        ("text.usetex", "savefig.transparent", "axes.grid", "figure.constrained_layout.use"), True
    ),
    **dict.fromkeys(("lines.antialiased", "axes.unicode_minus", "axes.spines.left"), False),
    **dict.fromkeys(("axes.facecolor", "figure.facecolor", "savefig.facecolor", "text.color"), "red"),
    **dict.fromkeys(("savefig.dpi", "figure.dpi", "font.size", "lines.linewidth"), 30),
    "font.family": "monospace",
    "image.interpolation": "nearest",
    "path.sketch": (3, 30, 5),
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
}
