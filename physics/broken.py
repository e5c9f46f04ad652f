"""What counts as broken, for solvers and for those who only look at results."""

#: phase field below which a moving crack has reached a point (Borden et al. 2012)
BROKEN = 0.25
