"""Run nodes that measure the graph or stress it."""


def package_of(name: str) -> str:
    """Return the package that a node stands in: the laboratory's or the product's."""
    return "dev.nodes" if name.startswith(("bench_", "fleet_", "soak_")) else "tirgeo_ros.nodes"
