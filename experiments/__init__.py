"""Questions about the method and the physics, each with a function and a figure."""
