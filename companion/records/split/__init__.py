"""Records of a split deployment: columns of the link, and the two sides of a flight in one."""
