"""From a photograph of a bent actuator to points on its bottom line, in mm, with errors."""
