"""Motion: arcs, their deviation in a flow, and how long a decision lasts."""
