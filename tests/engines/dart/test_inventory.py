"""DART's inventory: it equals the expectation of the world, additional calls are found, and every getter of dartpy is named."""

from __future__ import annotations

import dataclasses
import json
import re

import pytest

from simspec.compiler import compile_world
from simspec.dialects.dart.sidecar import DartSidecar
from simspec.dialects.kit.sidecar import SIDECAR
from simspec.engines.dart.engine import Dart
from simspec.errors import UnsupportedError
from simspec.proof.selftest_worlds import WORLDS
from tests.engines.inventories import inventory_check
from tests.planted import SHARED

dartpy = pytest.importorskip("dartpy")


def with_settings(world, *accept, **settings):
    given = world.options("dart")
    accepted = tuple(sorted({*given.accept, *accept}))
    given = dataclasses.replace(given, settings=tuple(sorted(settings.items())), accept=accepted)
    return dataclasses.replace(world, engines=(given,))


SETTINGS = {
    "collision_detector": "bullet",
    "contact_overflow": "log",
    "dry_friction_tolerance": 1e-9,
    "exact_rotation": "always",
    "iterations": 77,
    "sleeping": True,
    "tolerance": 1e-7,
}
SOUND = {
    **{name: lambda make=make: make("dart") for name, make in SHARED.items() if name not in ("rolling", "ground")},
    "settings": lambda: with_settings(WORLDS["bouncing"]("dart"), "shape.box", **SETTINGS),
    "dantzig": lambda: with_settings(WORLDS["bouncing"]("dart"), "contact.cone.elliptic", contact_solver="dantzig"),
    "fcl": lambda: with_settings(WORLDS["bouncing"]("dart"), collision_detector="fcl"),
    "never": lambda: with_settings(WORLDS["ball joint"]("dart"), exact_rotation="never"),
}


@pytest.fixture
def load(load_files):
    """A function that compiles and loads a world."""

    def of(world):
        files = compile_world(world, ["dart"])["dart"].files
        DartSidecar.of(json.loads(files[SIDECAR]))
        return load_files(Dart, files)

    return of


@pytest.mark.parametrize("name", SOUND)
def test_the_inventory_equals_the_expectation_of_the_world(name, load):
    world = SOUND[name]()
    check = inventory_check(world, load(world))
    assert check.passed, check.detail
    assert check.count > 50


def test_every_setting_is_tried():
    assert {*SETTINGS, "contact_solver"} == set(Dart.SETTINGS)
    assert all(Dart.SETTINGS[name].default != value for name, value in SETTINGS.items())


def test_features_that_dart_lacks_are_rejected():
    with pytest.raises(UnsupportedError, match="torsional_friction"):
        compile_world(WORLDS["rolling"]("dart"), ["dart"])


def joint(sim):
    return sim.world.getSkeleton("base").getJoint("upper_joint")


def node(sim):
    return sim.world.getSkeleton("cube").getBodyNode("cube")


def option(name, **changes):
    """A change of one of the solver's options, of which dartpy hands out copies."""

    def change(sim):
        of = sim.world if name == "DeactivationOptions" else sim.solver
        actual = getattr(of, f"get{name}")()
        for field, value in changes.items():
            setattr(actual, field, value)
        getattr(of, f"set{name}")(actual)

    return change


def weld(sim):
    sim.solver.addConstraint(dartpy.constraint.WeldJointConstraint(node(sim)))


BESIDES = {
    "gravity": lambda sim: sim.world.getSkeleton("cube").setGravity([0.0, 0.0, -1.0]),
    "immobile": lambda sim: sim.world.getSkeleton("cube").setMobile(False),
    "self-collision": lambda sim: sim.world.getSkeleton("base").disableSelfCollisionCheck(),
    "adjacent": lambda sim: sim.world.getSkeleton("base").disableAdjacentBodyCheck(),
    "weightless": lambda sim: node(sim).setGravityMode(False),
    "not collidable": lambda sim: node(sim).setCollidable(False),
    "pushed": lambda sim: node(sim).addExtForce([1.0, 0.0, 0.0]),
    "servo": lambda sim: joint(sim).setActuatorType(dartpy.dynamics.ActuatorType.SERVO),
    "locked": lambda sim: joint(sim).setActuatorType(dartpy.dynamics.ActuatorType.LOCKED),
    "spring": lambda sim: joint(sim).setRestPosition(0, 0.1),
    "damping": lambda sim: joint(sim).setDampingCoefficient(0, 0.1),
    "velocity": lambda sim: joint(sim).setVelocityUpperLimit(0, 1.0),
    "acceleration": lambda sim: joint(sim).setAccelerationLowerLimit(0, -1.0),
    "not enforced": lambda sim: joint(sim).setLimitEnforcement(False),
    "coupled": lambda sim: joint(sim).setUseCouplerConstraint(True),
    "split impulse": lambda sim: sim.solver.setSplitImpulseEnabled(True),
    "weld": weld,
    "timestep": lambda sim: sim.solver.setTimeStep(0.002),
    "sleeping": option("DeactivationOptions", mEnabled=True),
    "waking": option("DeactivationOptions", mWakeThresholdScale=9.0),
    "matrix-free": option("MatrixFreeContactSolverOptions", mMaxIterations=3),
    "detector": lambda sim: sim.world.setCollisionDetector(dartpy.simulation.CollisionDetectorType.ODE),
    "shape taken out": lambda sim: sim.solver.getCollisionGroup().removeAllShapeFrames(),
    "excluded pair": lambda sim: sim.excluded.append(("cube", "floor")),
    "secondary": lambda sim: sim.solver.setSecondaryBoxedLcpSolver(None),
}


@pytest.mark.parametrize("name", BESIDES)
def test_additional_calls_to_the_engine_are_found(name, load):
    world = WORLDS["model"]("dart")
    engine = load(world)
    BESIDES[name](engine._simulation)
    assert not inventory_check(world, engine).passed


QUESTION = re.compile(r"(get|is|has|are|needs)[A-Z]")
DYNAMICS = dartpy.dynamics
# Every getter of the installed version, by class (a name stands for several classes of a kind), and its use.

INVENTORY = "in the inventory"
READ_BACK = "a field of the read-back"
STATE = "state or what was computed from it, compared by levels L2, L3 and L6"
DERIVED = "follows from what is in the inventory or the read-back"
WAY = "leads to other objects, which are queried themselves"
LABEL = "a name or a number of order; names of bodies are those of the read-back"
UNUSED = "of what simspec has none of: counted, or a part of what is"

GETTERS = {
    "World": {
        INVENTORY: "getCollisionDetector getDeactivationOptions getNumSimpleFrames getNumSimulationThreads "
        "getNumSkeletons",
        READ_BACK: "getGravity getTimeStep",
        STATE: "getTime getLastCollisionResult",
        WAY: "getConstraintSolver getSkeleton getSimpleFrame getSimFrames",
        LABEL: "getIndex getName hasSkeleton",
    },
    "BoxedLcpConstraintSolver": {
        INVENTORY: "getBoxedLcpSolver getSecondaryBoxedLcpSolver getCollisionDetector getCollisionOption "
        "getMatrixFreeContactSolverOptions getNumConstraints getNumSimulationThreads getTimeStep "
        "isSplitImpulseEnabled",
        WAY: "getCollisionGroup",
        UNUSED: "getConstraint",
    },
    "CollisionOption": {INVENTORY: "getEffectiveMaxNumContactsPerPair"},
    "CollisionGroup": {
        INVENTORY: "getAutomaticUpdate getCollisionDetector getNumShapeFrames",
        LABEL: "hasShapeFrame",
    },
    "CollisionDetector": {
        INVENTORY: "getType getPrimitiveShapeType getContactPointComputationMethod",
        LABEL: "getStaticType",
    },
    "BoxedLcpSolver": {INVENTORY: "getType getOptions", LABEL: "getStaticType", STATE: "getStats"},
    "Skeleton": {
        INVENTORY: "isMobile getSelfCollisionCheck getAdjacentBodyCheck getGravity getTimeStep getNumSoftBodyNodes "
        "getNumMarkers getNumEndEffectors getNumTrees",
        DERIVED: "isEnabledSelfCollisionCheck isEnabledAdjacentBodyCheck getMass getNumBodyNodes getNumDofs "
        "getNumJoints getNumRigidBodyNodes getNumShapeNodes getProperties getAccelerationLowerLimit "
        "getAccelerationLowerLimits getAccelerationUpperLimit getAccelerationUpperLimits getForceLowerLimit "
        "getForceLowerLimits getForceUpperLimit getForceUpperLimits getPositionLowerLimit "
        "getPositionLowerLimits getPositionUpperLimit getPositionUpperLimits getVelocityLowerLimit "
        "getVelocityLowerLimits getVelocityUpperLimit getVelocityUpperLimits",
        STATE: "getAcceleration getAccelerations getAngularJacobian getAngularJacobianDeriv getAugMassMatrix getCOM "
        "getCOMJacobian getCOMJacobianSpatialDeriv getCOMLinearAcceleration getCOMLinearJacobian "
        "getCOMLinearJacobianDeriv getCOMLinearVelocity getCOMSpatialAcceleration getCOMSpatialVelocity "
        "getCommand getCommands getConfiguration getConstraintForces getCoriolisAndGravityForces "
        "getCoriolisForces getExternalForces getForce getForces getGravityForces getInvMassMatrix getJacobian "
        "getJacobianClassicDeriv getJacobianSpatialDeriv getJointConstraintImpulses getLinearJacobian "
        "getLinearJacobianDeriv getMassMatrix getPosition getPositionDifferences getPositions getState "
        "getVelocities getVelocity getVelocityChanges getVelocityDifferences getWorldJacobian "
        "isImpulseApplied",
        WAY: "getBodyNode getBodyNodes getDof getDofs getJoint getJoints getRootBodyNode getRootJoint getShapeNode "
        "getSkeleton getTreeBodyNodes getPtr",
        LABEL: "getName getIndexOf getLockableReference hasBodyNode hasJoint",
        UNUSED: "getIK getSupportVersion",
    },
    "BodyNode": {
        INVENTORY: "getGravityMode isCollidable getExternalForceGlobal getNumMarkers getNumEndEffectors",
        READ_BACK: "getInertia getParentJoint getParentBodyNode getShapeNode getShapeNodes",
        DERIVED: "getMass getMomentOfInertia getLocalCOM getBodyNodeProperties getNodeProperties getAllNodeProperties "
        "getNumShapeNodes getNumChildBodyNodes getNumChildJoints getNumDependentDofs getNumDependentGenCoords "
        "getChainDofs getDependentGenCoordIndex isReactive isFrame isShapeFrame isWorld isRemoved "
        "getNumChildEntities getNumChildFrames",
        STATE: "getAllNodeStates getNodeState getAngularJacobian getAngularJacobianDeriv getAngularMomentum "
        "getBodyForce getCOM getCOMLinearAcceleration getCOMLinearVelocity getCOMSpatialAcceleration "
        "getCOMSpatialVelocity getJacobian getJacobianClassicDeriv getJacobianSpatialDeriv getLinearJacobian "
        "getLinearJacobianDeriv getLinearMomentum getWorldJacobian getAngularAcceleration getAngularVelocity "
        "getLinearAcceleration getLinearVelocity getRelativeTransform getSpatialAcceleration "
        "getSpatialVelocity getTransform getWorldTransform needsAccelerationUpdate needsTransformUpdate "
        "needsVelocityUpdate",
        WAY: "getBodyNode getBodyNodePtr getChildBodyNode getChildJoint getSkeleton getChildEntities "
        "getChildFrames getParentFrame",
        LABEL: "getName getIndexInSkeleton getIndexInTree getTreeIndex isQuiet",
        UNUSED: "getIK getOrCreateIK",
    },
    "Joint": {
        INVENTORY: "areLimitsEnforced getActuatorType getActuatorTypeForDof getPositionLowerLimit getPositionUpperLimit "
        "getVelocityLowerLimit getVelocityUpperLimit getAccelerationLowerLimit getAccelerationUpperLimit "
        "getForceLowerLimit getForceUpperLimit getSpringStiffness getRestPosition getDampingCoefficient "
        "getCoulombFriction getCommand getGenericJointProperties isUsingCouplerConstraint isKinematic "
        "getNumDofs",
        READ_BACK: "getAxis getType getParentBodyNode getTransformFromChildBodyNode getTransformFromParentBodyNode",
        DERIVED: "getActuatorTypes hasActuatorType getPositionLowerLimits getPositionUpperLimits "
        "getVelocityLowerLimits getVelocityUpperLimits getAccelerationLowerLimits getAccelerationUpperLimits "
        "getForceLowerLimits getForceUpperLimits getCommands getBallJointProperties getFreeJointProperties "
        "getPrismaticJointProperties getRevoluteJointProperties getWeldJointProperties "
        "getZeroDofJointProperties getCompositeProperties hasPositionLimit isCyclic isDynamic "
        "hasGenericJointAspect hasJointAspect hasPrismaticJointAspect hasRevoluteJointAspect",
        STATE: "getAcceleration getAccelerations getBodyConstraintWrench getCompositeState getConstraintImpulse "
        "getForce getForces getPosition getPositions getPositionDifferences getPositionDifferencesStatic "
        "getRelativeJacobian getRelativeJacobianStatic getRelativeJacobianTimeDeriv "
        "getRelativePrimaryAcceleration getRelativeSpatialAcceleration getRelativeSpatialVelocity "
        "getRelativeTransform getVelocities getVelocity getVelocityChange getWrenchToChildBodyNode "
        "getWrenchToParentBodyNode getInitialPosition getInitialPositions getInitialVelocities "
        "getInitialVelocity",
        WAY: "getChildBodyNode getSkeleton",
        LABEL: "getName getDofName isDofNamePreserved getIndexInSkeleton getIndexInTree getJointIndexInSkeleton "
        "getJointIndexInTree getTreeIndex getStaticType",
    },
    "ShapeNode": {
        READ_BACK: "getShape getRelativeTransform getCollisionAspect getDynamicsAspect getVisualAspect "
        "hasCollisionAspect hasVisualAspect",
        DERIVED: "getOffset getRelativeRotation getRelativeTranslation getShapeNodeProperties getNodeProperties "
        "hasDynamicsAspect getNumDependentDofs getNumDependentGenCoords getChainDofs "
        "getDependentGenCoordIndex isShapeNode isRemoved isFrame isShapeFrame isWorld getNumChildEntities "
        "getNumChildFrames",
        STATE: "getNodeState getAngularJacobian getAngularJacobianDeriv getJacobian getJacobianClassicDeriv "
        "getJacobianSpatialDeriv getLinearJacobian getLinearJacobianDeriv getWorldJacobian "
        "getAngularAcceleration getAngularVelocity getLinearAcceleration getLinearVelocity "
        "getSpatialAcceleration getSpatialVelocity getTransform getWorldTransform needsAccelerationUpdate "
        "needsTransformUpdate needsVelocityUpdate",
        WAY: "getBodyNode getBodyNodePtr getSkeleton getChildEntities getChildFrames getParentFrame",
        LABEL: "getName isQuiet",
        UNUSED: "getIK getOrCreateIK",
    },
    "Aspect": {
        READ_BACK: "isCollidable getFrictionCoeff getRestitutionCoeff getRGBA",
        DERIVED: "getCollidable getAlpha getColor getRGB",
        UNUSED: "getHidden isHidden getShadowed",
    },
    "Inertia": {READ_BACK: "getMass getLocalCOM getMoment", DERIVED: "getSpatialTensor"},
    "Shape": {
        READ_BACK: "getType getSize getRadius getHeight getRadii getNormal getOffset",
        DERIVED: "getDiameters getBoundingBox getVolume isSphere",
        LABEL: "getID getStaticType getDataVariance",
    },
}
"""By class, what becomes of them, and their names."""

FIELDS = {
    "CollisionOption": (
        "allowNegativePenetrationDepthContacts",
        "collisionFilter",
        "enableContact",
        "maxNumContacts",
        "maxNumContactsPerPair",
    ),
    "DeactivationOptions": (
        "mAngularSpeedThreshold",
        "mEnabled",
        "mLinearSpeedThreshold",
        "mTimeUntilSleep",
        "mWakeThresholdScale",
    ),
    "MatrixFreeContactSolverOptions": (
        "mDeltaTolerance",
        "mEnabled",
        "mEpsilonForDivision",
        "mMaxIterations",
        "mMinRows",
        "mRelativeDeltaTolerance",
        "mSor",
    ),
    "NsgsFrictionSolver.Options": ("boxForAnisotropic", "law", "maxSweeps", "tolerance"),
}
"""The fields of plain options, all of them in the inventory."""

NOT_REPORTED = (
    "the pairs of its collision filter, which DART does not report: the inventory holds those that simspec set",
    "the numbers of the secondary solver (PgsBoxedLcpSolver), which it uses when Dantzig's or NSGS fails",
    "of a shape the second friction coefficient, slip compliances and the direction of friction, which .skel cannot set",
)
"""Values that dartpy does not report."""

CLASSES = {
    "World": [dartpy.simulation.World],
    "BoxedLcpConstraintSolver": [dartpy.constraint.BoxedLcpConstraintSolver],
    "CollisionOption": [dartpy.collision.CollisionOption],
    "CollisionGroup": [dartpy.collision.CollisionGroup],
    "CollisionDetector": [
        getattr(dartpy.collision, f"{name}CollisionDetector") for name in ("DART", "Ode", "Bullet", "FCL")
    ],
    "BoxedLcpSolver": [
        getattr(dartpy.constraint, name)
        for name in ("NsgsFrictionSolver", "DantzigBoxedLcpSolver", "PgsBoxedLcpSolver")
    ],
    "Skeleton": [DYNAMICS.Skeleton],
    "BodyNode": [DYNAMICS.BodyNode],
    "Joint": [getattr(DYNAMICS, f"{name}Joint") for name in ("Weld", "Revolute", "Prismatic", "Ball", "Free")],
    "ShapeNode": [DYNAMICS.ShapeNode],
    "Aspect": [getattr(DYNAMICS, f"{name}Aspect") for name in ("Dynamics", "Collision", "Visual")],
    "Inertia": [DYNAMICS.Inertia],
    "Shape": [
        getattr(DYNAMICS, f"{name}Shape") for name in ("Sphere", "Box", "Cylinder", "Capsule", "Ellipsoid", "Plane")
    ],
}


@pytest.mark.parametrize("name", CLASSES)
def test_no_getter_is_left_unnamed(name):
    installed = {method for entry in CLASSES[name] for method in dir(entry) if QUESTION.match(method)}
    named = [method for methods in GETTERS[name].values() for method in methods.split()]
    assert sorted(named) == sorted(installed)


def test_no_option_is_left_unnamed():
    for path, fields in FIELDS.items():
        found = dartpy.simulation if path.startswith("Deactivation") else dartpy.constraint
        found = dartpy.collision if path.startswith("Collision") else found
        for part in path.split("."):
            found = getattr(found, part)
        of_type = [name for name in dir(found) if not name.startswith("_") and not name.startswith("get")]
        assert sorted(of_type) == sorted(fields)
    assert set(CLASSES) == set(GETTERS)
