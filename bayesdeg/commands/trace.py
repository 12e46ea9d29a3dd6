"""``bayesdeg trace``: from photographs to points on the bottom line, by the camera extra."""

from collections.abc import Callable

from bayesdeg.extras import camera

trace_photographs: Callable[..., None] = camera("trace", "bayesdeg trace")
