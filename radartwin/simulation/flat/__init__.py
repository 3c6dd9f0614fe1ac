"""Image sources for rooms of flat panels."""
