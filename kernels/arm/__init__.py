"""A serial arm before cameras: projected features, their derivatives, joints from pixels."""
