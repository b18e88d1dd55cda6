"""Exudyn's reduced-order body with the K, M and modes of a body of flexmb.

Its formulation is the nodal floating frame of reference (Zwoelfer and Gerstmayr, Acta Mechanica
231 (2020) 3019), with all inertia terms: full coupling without geometric stiffening.
"""

from __future__ import annotations

import exudyn as exu
import numpy as np
from exudyn import itemInterface as items
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from scipy.sparse import csr_matrix


def ends_of_pushed_body(points, M, K, modes, pushes, times, h):
    """Mean positions (t, 3) of groups of nodes of a free body that starts from rest.

    Parameters
    ----------
    points, M, K : (n, 3), (3 n, 3 n) and (3 n, 3 n) array
        Nodes and matrices of the full model.
    modes : (3 n, m) array
        Without rigid motions.
    pushes : list of (indices, function)
        Nodes that share a force (3,) of time.
    times : (t,) array
        At equal distances.
    h : float
        Step of generalized-alpha, spectral radius 0.9.
    """
    model = FEMinterface()
    model.nodes = {"Position": points.copy()}
    model.modeBasis = {"matrix": modes, "type": "NormalModes"}
    model.GetMassMatrix = lambda sparse=True: csr_matrix(M)
    model.GetStiffnessMatrix = lambda sparse=True: csr_matrix(K)
    reduced = ObjectFFRFreducedOrderInterface(model, roundMassMatrix=0, roundStiffnessMatrix=0)
    container = exu.SystemContainer()
    system = container.AddSystem()
    body = reduced.AddObjectFFRFreducedOrder(system)["oFFRFreducedOrder"]
    sensors = []
    for nodes, force in pushes:
        sensors.append([])
        for node in map(int, nodes):
            at = items.MarkerSuperElementPosition(
                bodyNumber=body, meshNodeNumbers=[node], weightingFactors=[1.0]
            )

            def load(_, t, __, force=force, nodes=nodes):
                return list(force(t) / len(nodes))

            system.AddLoad(items.Force(
                markerNumber=system.AddMarker(at), loadVector=[1, 1, 1], loadVectorUserFunction=load
            ))  # fmt: skip
            sensors[-1].append(system.AddSensor(items.SensorSuperElement(
                bodyNumber=body, meshNodeNumber=node, storeInternal=True, writeToFile=False,
                outputVariableType=exu.OutputVariableType.Position,
            )))  # fmt: skip
    system.Assemble()
    settings = exu.SimulationSettings()
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = times[1] - times[0]
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime = round(times[-1] / h), times[-1]
    integration.generalizedAlpha.spectralRadius = 0.9
    integration.newton.relativeTolerance = 1e-10
    integration.verboseMode = 0
    system.SolveDynamic(settings)
    stored = [np.mean([system.GetSensorStoredData(k) for k in one], axis=0) for one in sensors]
    return [np.array([row[np.argmin(np.abs(row[:, 0] - t)), 1:] for t in times]) for row in stored]
