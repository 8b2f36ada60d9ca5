"""Which setting, quantity or moment a difference between two engines comes from."""
