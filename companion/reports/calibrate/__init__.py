"""What a hover flight says about vehicle and room: thrust, attitude loop, delays. Pure computing over a record."""
