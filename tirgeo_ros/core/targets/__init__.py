"""Hold targets: places that a person clicked, averaged over their clicks."""
