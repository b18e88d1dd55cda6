"""Where the equations and the modes of flexible bodies hold: one monitor for each limit."""
