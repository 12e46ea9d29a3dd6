"""The forward map: a finite element model of the actuator."""
