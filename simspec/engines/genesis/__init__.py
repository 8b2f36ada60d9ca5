"""Genesis: MJCF and URDF by its own loader, in double precision on the processor."""
