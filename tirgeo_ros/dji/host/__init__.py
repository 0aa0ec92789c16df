"""Ask the aircraft for activation and subscriptions."""
