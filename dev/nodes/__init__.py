"""Run nodes that measure the graph or stress it."""

NAMES = ("bench_video", "bench_viewer", "bench_relay", "soak_player", "soak_witness", "soak_mute")


def package_of(name: str) -> str:
    """Return the package that a node stands in: the laboratory's or the product's."""
    return "dev.nodes" if name in NAMES else "tirgeo_ros.nodes"
