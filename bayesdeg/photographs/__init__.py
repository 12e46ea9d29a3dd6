"""From pictures of a bent actuator to points on its bottom line, in mm, with errors."""
