"""An arm captures a satellite here; Basilisk has the orbit, its environment and the flight software.

Basilisk: gravity with J2, drag, solar pressure with eclipse; navigation, guidance, ``mrpFeedback`` and wheel
torques. Here: two arms on the base, their control, the capture and its impact, the wheels.
Needs ``pip install 'spacerobot[basilisk]'``.
"""

from pathlib import Path

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.fswAlgorithms import attTrackingError, inertial3D, mrpFeedback, rwMotorTorque
from Basilisk.simulation import (
    dragDynamicEffector,
    eclipse,
    exponentialAtmosphere,
    gravityEffector,
    radiationPressure,
    simpleNav,
    spacecraft,
)
from Basilisk.utilities import SimulationBaseClass, macros

import spacerobot as sr

WHEELS = {
    "kind": "reaction_wheels",
    "pyramid": {"wheels": 4, "tilt_deg": 35.26},
    "inertia": 0.5,
    "torque_limit": 8,
}


def environment(craft):
    """Attach Earth's environment to a spacecraft; return its modules and messages."""
    earth, field = gravityEffector.GravBodyData(), gravityEffector.SphericalHarmonicsGravityModel()
    field.cBar = [[1.0], [0.0, 0.0], [-1.08263e-3 / np.sqrt(5), 0.0, 0.0]]  # J2 alone, normalised
    field.sBar, field.maxDeg = [[0.0], [0.0, 0.0], [0.0, 0.0, 0.0]], 2
    earth.planetName, earth.isCentralBody, earth.gravityModel = "earth", True, field
    earth.mu, earth.radEquator = 3.986004415e14, 6378136.3
    craft.gravField.gravBodies = gravityEffector.GravBodyVector([earth])
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = [6778e3, 0.0, 0.0], [0.0, 4.78e3, 6.01e3]
    planet, sun = messaging.SpicePlanetStateMsgPayload(), messaging.SpicePlanetStateMsgPayload()
    planet.PlanetName, planet.J20002Pfix = "earth", np.eye(3).tolist()
    sun.PlanetName, sun.PositionVector = "sun", [1.496e11, 0.0, 0.0]
    planets = [messaging.SpicePlanetStateMsg().write(payload) for payload in (planet, sun)]

    air, drag = exponentialAtmosphere.ExponentialAtmosphere(), dragDynamicEffector.DragDynamicEffector()
    air.planetRadius, air.baseDensity, air.scaleHeight = 6378136.3, 3.614e-13 * np.exp(400 / 58.5), 58.5e3
    air.addSpacecraftToModel(craft.scStateOutMsg)
    drag.coreParams.projectedArea, drag.coreParams.dragCoeff = 4.0, 2.2
    drag.atmoDensInMsg.subscribeTo(air.envOutMsgs[0])
    shadow, light = eclipse.Eclipse(), radiationPressure.RadiationPressure()
    shadow.sunInMsg.subscribeTo(planets[1])
    shadow.addPlanetToModel(planets[0])
    shadow.addSpacecraftToModel(craft.scStateOutMsg)
    light.area, light.coefficientReflection = 5.0, 1.3
    light.sunEphmInMsg.subscribeTo(planets[1])
    light.sunEclipseInMsg.subscribeTo(shadow.eclipseOutMsgs[0])
    craft.addDynamicEffector(drag)
    craft.addDynamicEffector(light)
    return (air, shadow, drag, light), (planets, earth)


def flight_software(scene):
    """Attitude control from the state message of the base to the motors of its wheels."""
    navigation, guidance = simpleNav.SimpleNav(), inertial3D.inertial3D()
    error, law, motors = (
        attTrackingError.attTrackingError(),
        mrpFeedback.mrpFeedback(),
        rwMotorTorque.rwMotorTorque(),
    )
    navigation.scStateInMsg.subscribeTo(scene.scStateOutMsg)
    error.attNavInMsg.subscribeTo(navigation.attOutMsg)
    error.attRefInMsg.subscribeTo(guidance.attRefOutMsg)
    law.guidInMsg.subscribeTo(error.attGuidOutMsg)
    law.vehConfigInMsg.subscribeTo(scene.vehicleConfigOutMsg)
    law.rwParamsInMsg.subscribeTo(scene.rwParamsOutMsg)
    law.rwSpeedsInMsg.subscribeTo(scene.rwSpeedOutMsg)
    law.K, law.P, law.Ki = 30.0, 250.0, -1.0
    motors.controlAxes_B = np.eye(3).ravel().tolist()
    motors.vehControlInMsg.subscribeTo(law.cmdTorqueOutMsg)
    motors.rwParamsInMsg.subscribeTo(scene.rwParamsOutMsg)
    scene.rwMotorTorqueInMsg.subscribeTo(motors.rwMotorTorqueOutMsg)
    return navigation, guidance, error, law, motors


def main(duration_s=29.0, step_s=0.1, folder="out/examples/basilisk"):
    """Simulate the capture, print what both sides say, draw it."""
    craft = spacecraft.Spacecraft()
    modules, subscriptions = environment(craft)
    scenario = sr.load_scene("capture", {"robots.servicer.actuators": {"wheels": WHEELS}})
    scene = sr.make_basilisk_scene(scenario, spacecraft=craft, period=step_s)
    software, states = flight_software(scene), scene.scStateOutMsg.recorder()
    simulation = SimulationBaseClass.SimBaseClass()
    simulation.CreateNewProcess("process").addTask(simulation.CreateNewTask("task", macros.sec2nano(step_s)))
    for module in (
        scene,
        craft,
        *modules,
        *software,
        states,
    ):  # the scene first: commands act on the next step
        simulation.AddModelToTask("task", module)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(duration_s))
    simulation.ExecuteSimulation()

    result = scene.result()
    print(result)
    for event in result.summary["events"]:
        if event["kind"] == "captured":
            print(f"{event['who']} captured at {event['time_s']:.2f} s")
    turned = 4 * np.degrees(np.arctan(np.linalg.norm(states.sigma_BN, axis=1)))
    way, height = np.linalg.norm(states.r_BN_N[-1] - states.r_BN_N[0]), np.linalg.norm(states.r_BN_N[-1])
    light, speeds = modules[1].eclipseOutMsgs[0].read().shadowFactor, scene.output("wheel_speed").round(1)
    print(f"base turned by {turned.max():.2f} deg at most, {turned[-1]:.2f} deg at the end")
    print(f"flew {way / 1e3:.1f} km, now {(height - 6378136.3) / 1e3:.1f} km high, sunlight {light:.0%}")
    print(f"wheels {speeds} rad/s")
    sr.figures(result, Path(folder), names=["tip_errors"], formats=["png"])
    sr.animate(result, Path(folder) / "capture.html")
    del subscriptions  # Basilisk does not keep its messages
    return result


if __name__ == "__main__":
    main()
