"""A thin, simply supported square plate under pressure: Navier's double series.

Timoshenko, Woinowsky-Krieger (1959), Theory of Plates and Shells, section 28. In units of the side
a, the pressure q and the plate stiffness D. Run it: it prints what scene.toml quotes.
"""

import numpy as np

NU = 0.3
odd = np.arange(1, 400, 2)
m, n = np.meshgrid(odd, odd, indexing="ij")
amplitude = 16 / (np.pi**6 * m * n * (m**2 + n**2) ** 2)
at_middle = np.sin(m * np.pi / 2) * np.sin(n * np.pi / 2)

deflection = np.sum(amplitude * at_middle)  # q a^4/D
moment = np.sum(amplitude * np.pi**2 * (m**2 + NU * n**2) * at_middle)  # q a^2

assert abs(deflection - 0.00406235) < 1e-8
assert abs(moment - 0.0478864) < 1e-6
print(f"deflection in the middle {deflection:.8f} q a^4/D, moment {moment:.7f} q a^2")
