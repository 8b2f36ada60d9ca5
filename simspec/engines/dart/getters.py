"""What dartpy can be asked of each of DART's classes, and what becomes of the answer: data, for people and for a test.

Every method of the installed version whose name begins with get, is, has, are, needs is here, under its class (one name stands
for several classes of a kind) and what becomes of it. So a new version that can tell more fails the test until that is decided.
"""

from __future__ import annotations

from collections.abc import Mapping

INVENTORY = "in the inventory"
READ_BACK = "a field of the read-back"
STATE = "state or what was computed from it, compared by levels L2, L3 and L6"
DERIVED = "follows from what is in the inventory or the read-back"
WAY = "leads to other objects, which are asked themselves"
LABEL = "a name or a number of order; names of bodies are those of the read-back"
UNUSED = "of what simspec has none of: counted, or a part of what is"

GETTERS: Mapping[str, Mapping[str, str]] = {
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

FIELDS: Mapping[str, tuple[str, ...]] = {
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

NOT_TOLD = (
    "the pairs of its collision filter, which DART does not report: the inventory holds those that simspec set",
    "the numbers of the secondary solver (PgsBoxedLcpSolver), which it uses when Dantzig's or NSGS fails",
    "of a shape the second friction coefficient, slip compliances and the direction of friction, which .skel cannot set",
)
"""What dartpy does not tell."""
