"""Environment of a Basilisk spacecraft: Earth with J2, atmosphere, sunlight with eclipse, magnetic field."""

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.simulation import (
    MtbEffector,
    dragDynamicEffector,
    eclipse,
    exponentialAtmosphere,
    gravityEffector,
    magneticFieldCenteredDipole,
    radiationPressure,
)

MU, RADIUS, J2 = 3.986004415e14, 6378136.3, 1.08263e-3
START = np.array([-1.2e6, 6.55e6, 1.1e6]), np.array([-5.2e3, -1.7e3, 5.3e3])
"""Position [m] and velocity [m/s] in N: 380 km high, on the way into the shadow."""
DIPOLE = 80.0
"""Magnetic dipole of the torque rods along the body's x axis [A m^2]."""


def with_earth(craft):
    """Attach gravity and effectors to a spacecraft; return the modules to add behind it, in their order."""
    harmonics = gravityEffector.SphericalHarmonicsGravityModel()
    harmonics.cBar = [[1.0], [0.0, 0.0], [-J2 / np.sqrt(5), 0.0, 0.0]]
    harmonics.sBar = [[0.0], [0.0, 0.0], [0.0, 0.0, 0.0]]
    harmonics.maxDeg = 2
    earth = gravityEffector.GravBodyData()
    earth.planetName, earth.mu, earth.radEquator, earth.isCentralBody = "earth", MU, RADIUS, True
    earth.gravityModel = harmonics
    craft.gravField.gravBodies = gravityEffector.GravBodyVector([earth])
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = START[0].tolist(), START[1].tolist()

    air = exponentialAtmosphere.ExponentialAtmosphere()
    air.planetRadius, air.baseDensity, air.scaleHeight = RADIUS, 1.217, 8500.0 * 2.2
    drag = dragDynamicEffector.DragDynamicEffector()
    drag.coreParams.projectedArea, drag.coreParams.dragCoeff = 4.0, 2.2
    drag.coreParams.comOffset = [0.3, 0.1, -0.2]
    air.addSpacecraftToModel(craft.scStateOutMsg)
    drag.atmoDensInMsg.subscribeTo(air.envOutMsgs[0])

    planet, sun = messaging.SpicePlanetStateMsgPayload(), messaging.SpicePlanetStateMsgPayload()
    planet.PlanetName, sun.PlanetName = "earth", "sun"
    planet.J20002Pfix = np.eye(3).tolist()
    sun.PositionVector = [1.496e11, 0.0, 0.0]
    messages = [messaging.SpicePlanetStateMsg().write(payload) for payload in (planet, sun)]
    shadow = eclipse.Eclipse()
    shadow.sunInMsg.subscribeTo(messages[1])
    shadow.addPlanetToModel(messages[0])
    shadow.addSpacecraftToModel(craft.scStateOutMsg)
    light = radiationPressure.RadiationPressure()
    light.setUseCannonballModel()
    light.area, light.coefficientReflection = 5.0, 1.3
    light.sunEphmInMsg.subscribeTo(messages[1])
    light.sunEclipseInMsg.subscribeTo(shadow.eclipseOutMsgs[0])

    field = magneticFieldCenteredDipole.MagneticFieldCenteredDipole()
    field.g10, field.g11, field.h11, field.planetRadius = -30926e-9, -2318e-9, 5817e-9, RADIUS
    field.addSpacecraftToModel(craft.scStateOutMsg)
    rods, command = messaging.MTBArrayConfigMsgPayload(), messaging.MTBCmdMsgPayload()
    rods.numMTB, rods.GtMatrix_B, rods.maxMtbDipoles = 1, [1.0, 0.0, 0.0], [2 * DIPOLE]
    command.mtbDipoleCmds = [DIPOLE]
    messages += [messaging.MTBArrayConfigMsg().write(rods), messaging.MTBCmdMsg().write(command)]
    coils = MtbEffector.MtbEffector()
    coils.mtbParamsInMsg.subscribeTo(messages[2])
    coils.mtbCmdInMsg.subscribeTo(messages[3])
    coils.magInMsg.subscribeTo(field.envOutMsgs[0])

    for effector in (drag, light, coils):
        craft.addDynamicEffector(effector)
    craft.__dict__["kept"] = (earth, harmonics, messages)  # Basilisk does not keep them
    return air, shadow, field, drag, light, coils
