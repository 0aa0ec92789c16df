"""Judge samples by themselves: numbers, stamps, rates and silence."""
