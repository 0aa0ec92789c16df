"""``make soak``: the node graph for long, with everything that can happen to its processes."""
