"""Units of the aircraft."""

from __future__ import annotations

#: The unit in which accelerations in g count (3rd CGPM, 1901).
STANDARD_GRAVITY_M_S2 = 9.80665
