"""Bodies of material points that move, collide and break (thesis Algorithm 3)."""
