"""A thin, simply supported square plate under pressure: Navier's double series.

Timoshenko, Woinowsky-Krieger (1959), Theory of Plates and Shells, section 28. In units of the side
a, the pressure q and the plate stiffness D.
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
a, h, E, q = 10, 0.05, 200e9, 1000  # of scene.toml
D = E * h**3 / (12 * (1 - NU**2))
hertz = np.sqrt(D / (8000 * h)) / (2 * np.pi * a**2)
for number, waves in ((1, 2), (2, 5), (4, 8)):  # m^2 + n^2
    print(f"frequency.{number} {waves * np.pi**2 * hertz:.12g}")
print(f"displacement.312.z {deflection * q * a**4 / D:.12g}")
print(f"shell_force.312.Mx {moment * q * a**2:.12g}")
print(f"stress.312.top.xx {6 * moment * q * a**2 / h**2:.12g}")
