"""From a wanted rebound to the constants of a block, and back."""
