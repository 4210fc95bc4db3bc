"""Control law on the ground: motion capture in, commands to the vehicle out."""
