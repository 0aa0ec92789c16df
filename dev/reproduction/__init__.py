"""``docs/reproduction.md``: the paper's tables beside what the commands give in the simulator."""
