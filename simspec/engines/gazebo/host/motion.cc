// Coordinates, efforts and steps.

#include "simspec_gazebo.h"

#include <cmath>

using Eigen::Map;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

// Numbers beyond this have squares that overflow in a step.
const double MOST = 1e100;

// DART turns vectors between these lengths by a Taylor form: the same rotation is then given the long way round.
const double SMALL_TURN[2] = {1e-5, 1e-3};

const int POSITIONS[] = {0, 1, 1, 4, 7};
const int VELOCITIES[] = {0, 1, 1, 3, 6};

Quaterniond exponential(const Vector3d &vector) {
  double angle = vector.norm();
  double half = 0.5 * angle;
  double factor = angle > 1e-8 ? std::sin(half) / angle : 0.5;
  Quaterniond turn(std::cos(half), factor * vector.x(), factor * vector.y(), factor * vector.z());
  return turn.normalized();
}

// log R with an angle of at most pi.
Vector3d logarithm(Quaterniond turn) {
  if (turn.w() < 0.0) turn.coeffs() *= -1.0;
  double sine = turn.vec().norm();
  if (sine == 0.0) return Vector3d::Zero();
  return turn.vec() * (2.0 * std::atan2(sine, turn.w()) / sine);
}

bool turns(const Body &body) { return body.kind == BALL || body.kind == FREE; }

// The joint's own rotation, put where ``turn`` is; a free body's place is kept.
void lay(Body &body) {
  VectorXd q = body.joint->getPositions();
  q.head<3>() = rotation_vector(body.turn);
  body.joint->setPositions(q);
}

// What acts along the joint's coordinates by damping, spring and the effort against the damping that stands for armature.
void own_efforts(const Sim &sim, const Body &body, VectorXd &force) {
  double loss = body.damping - body.armature / sim.timestep;
  if (body.kind == BALL) {
    force.segment<3>(body.dof) -= loss * Vector3d(body.joint->getVelocities());
    if (body.stiffness) force.segment<3>(body.dof) -= body.stiffness * logarithm(body.turn);
  } else if (body.kind != FREE) {
    force[body.dof] -= loss * body.joint->getVelocity(0);
    force[body.dof] -= body.stiffness * (body.joint->getPosition(0) - body.rest);
  }
}

}  // namespace

Vector3d rotation_vector(const Quaterniond &turn) {
  Vector3d vector = logarithm(turn);
  double angle = vector.norm();
  if (angle > SMALL_TURN[0] && angle < SMALL_TURN[1]) vector *= 1.0 - 2.0 * M_PI / angle;
  return vector;
}

bool sound(const VectorXd &values) { return values.allFinite() && (!values.size() || values.cwiseAbs().maxCoeff() < MOST); }

bool sound(const Sim &sim) {
  for (const auto &tree : sim.trees)
    if (!sound(tree.skeleton->getPositions()) || !sound(tree.skeleton->getVelocities())) return false;
  return true;
}

// T with v_DART = T v: a free body's (velocity in world axes, omega in its own) to (omega, velocity), both in its own.
MatrixXd velocity_map(const Sim &sim, const Tree &tree) {
  MatrixXd found = MatrixXd::Zero(tree.size, tree.size);
  int column = 0;
  for (int index : tree.bodies) {
    const Body &body = sim.bodies[index];
    int count = VELOCITIES[body.kind];
    if (body.kind == FREE) {
      found.block<3, 3>(body.dof, column + 3).setIdentity();
      found.block<3, 3>(body.dof + 3, column) = body.turn.toRotationMatrix().transpose();
    } else {
      found.block(body.dof, column, count, count).setIdentity();
    }
    column += count;
  }
  return found;
}

extern "C" {

// The bodies in the world's order, found by their links' names: what has no link of its name, or another kind of joint, is an
// error. numbers: damping, stiffness, rest, armature of each.
int gz_bodies(Sim *sim, int count, const char **names, const int *kinds, const double *numbers) {
  std::unordered_map<const dart::dynamics::Skeleton *, int> tree_of;
  for (int i = 0; i < count; i++) {
    auto found = sim->named.find(names[i]);
    if (found == sim->named.end()) {
      said = std::string("gz-physics has no link ") + names[i];
      return -1;
    }
    Body body{static_cast<Kind>(kinds[i]), found->second, found->second->getParentJoint(), 0, sim->nq, sim->nv, 0,
              numbers[4 * i], numbers[4 * i + 1], numbers[4 * i + 2], numbers[4 * i + 3], true, Quaterniond::Identity()};
    static const char *types[] = {"WeldJoint", "RevoluteJoint", "PrismaticJoint", "BallJoint", "FreeJoint"};
    if (body.joint->getType() != types[body.kind]) {
      said = std::string("the joint of ") + names[i] + " is a " + body.joint->getType() + " in gz-physics";
      return -1;
    }
    auto *skeleton = body.node->getSkeleton().get();
    auto [place, fresh] = tree_of.emplace(skeleton, static_cast<int>(sim->trees.size()));
    if (fresh) sim->trees.push_back({skeleton, {}, false, static_cast<int>(skeleton->getNumDofs())});
    body.tree = place->second;
    if (VELOCITIES[body.kind]) {
      body.dof = static_cast<int>(body.joint->getIndexInSkeleton(0));
      sim->trees[body.tree].bodies.push_back(i);
    }
    if (body.damping || body.stiffness || body.armature) sim->trees[body.tree].driven = true;
    sim->nq += POSITIONS[body.kind];
    sim->nv += VELOCITIES[body.kind];
    sim->bodies.push_back(body);
  }
  if (sim->named.size() != sim->bodies.size()) {
    said = "gz-physics has more links than the text";
    return -1;
  }
  return 0;
}

// The inertia of a body that SDF cannot say: mass, centre of mass, moments and products about it in the link's axes.
void gz_inertia(Sim *sim, int body, const double *numbers) {
  Quiet quiet;  // DART warns of bodies without mass, which simspec has only where they cannot move or carry others
  dart::dynamics::Inertia inertia;
  inertia.setMass(numbers[0]);
  inertia.setLocalCOM(Vector3d(numbers[1], numbers[2], numbers[3]));
  Matrix3d moment;
  moment << numbers[4], numbers[7], numbers[8], numbers[7], numbers[5], numbers[9], numbers[8], numbers[9], numbers[6];
  inertia.setMoment(moment);
  sim->bodies[body].node->setInertia(inertia);
}

void gz_set(Sim *sim, const double *q, const double *v) {
  for (auto &body : sim->bodies) {
    const double *at = q + body.q, *rate = v + body.v;
    if (body.kind == HINGE || body.kind == SLIDE) {
      body.joint->setPosition(0, at[0]);
      body.joint->setVelocity(0, rate[0]);
    } else if (body.kind == BALL) {
      body.turn = Quaterniond(at[0], at[1], at[2], at[3]).normalized();
      body.joint->setPositions(rotation_vector(body.turn));
      body.joint->setVelocities(Vector3d(rate[0], rate[1], rate[2]));
    } else if (body.kind == FREE) {
      body.turn = Quaterniond(at[3], at[4], at[5], at[6]).normalized();
      VectorXd place(6), motion(6);
      place << rotation_vector(body.turn), Vector3d(at[0], at[1], at[2]);
      motion << Vector3d(rate[3], rate[4], rate[5]), body.turn.conjugate() * Vector3d(rate[0], rate[1], rate[2]);
      body.joint->setPositions(place);
      body.joint->setVelocities(motion);
    }
  }
  for (auto &tree : sim->trees) {
    tree.skeleton->setAccelerations(VectorXd::Zero(tree.size));
    tree.skeleton->clearInternalForces();
    tree.skeleton->clearExternalForces();
    tree.skeleton->clearConstraintImpulses();
  }
  sim->world->getConstraintSolver()->clearLastCollisionResult();
}

void gz_get(const Sim *sim, double *q, double *v) {
  for (const auto &body : sim->bodies) {
    double *at = q + body.q, *rate = v + body.v;
    if (body.kind == HINGE || body.kind == SLIDE) {
      at[0] = body.joint->getPosition(0);
      rate[0] = body.joint->getVelocity(0);
    } else if (turns(body)) {
      VectorXd place = body.joint->getPositions(), motion = body.joint->getVelocities();
      double *turn = at;
      if (body.kind == FREE) {
        Map<Vector3d>(at, 3) = place.tail<3>();
        Map<Vector3d>(rate, 3) = body.turn * Vector3d(motion.tail<3>());
        turn = at + 3;
        rate += 3;
      }
      Quaterniond held = body.turn;
      if (held.w() < 0.0) held.coeffs() *= -1.0;
      turn[0] = held.w(), turn[1] = held.x(), turn[2] = held.y(), turn[3] = held.z();
      Map<Vector3d>(rate, 3) = motion.head<3>();
    }
  }
}

// Poses of the links' frames (n, 7: place, quaternion w x y z) and velocities (n, 6: of the origin, angular) in the world.
void gz_frames(const Sim *sim, double *poses, double *velocities) {
  for (const auto &body : sim->bodies) {
    const auto &place = body.node->getWorldTransform();
    Map<Vector3d>(poses, 3) = place.translation();
    Quaterniond turn(Matrix3d(place.linear()));
    if (turn.w() < 0.0) turn.coeffs() *= -1.0;
    turn.normalize();
    poses[3] = turn.w(), poses[4] = turn.x(), poses[5] = turn.y(), poses[6] = turn.z();
    Map<Vector3d>(velocities, 3) = body.node->getLinearVelocity();
    Map<Vector3d>(velocities + 3, 3) = body.node->getAngularVelocity();
    poses += 7;
    velocities += 6;
  }
}

// Steps under a constant effort (nv; null: none). The rotations of balls and free bodies are redone: they go by the exponential
// of the new angular velocity, where DART's own come by a Taylor form. 1: a state or effort is not finite, or would overflow,
// which would end the process.
int gz_step(Sim *sim, int count, const double *effort) {
  try {
    for (int n = 0; n < count; n++) {
      if (!sound(*sim)) return 1;
      for (const auto &tree : sim->trees) {
        if (!tree.size || (!effort && !tree.driven)) continue;
        VectorXd force = VectorXd::Zero(tree.size);
        for (int index : tree.bodies) {
          const Body &body = sim->bodies[index];
          if (effort) {
            const double *given = effort + body.v;
            if (body.kind == FREE) {
              force.segment<3>(body.dof) = Vector3d(given[3], given[4], given[5]);
              force.segment<3>(body.dof + 3) = body.turn.conjugate() * Vector3d(given[0], given[1], given[2]);
            } else {
              for (int k = 0; k < VELOCITIES[body.kind]; k++) force[body.dof + k] = given[k];
            }
          }
          if (tree.driven) own_efforts(*sim, body, force);
        }
        if (!sound(force)) return 1;
        tree.skeleton->setForces(force);
      }
      if (sim->fresh) {  // which the profiler's complaint about its port belongs to
        Quiet quiet;
        Unprofiled unprofiled;
        sim->fresh = false;
        sim->step();
      } else {
        sim->step();
      }
      for (auto &body : sim->bodies) {
        if (!turns(body)) continue;
        VectorXd motion = body.joint->getVelocities();
        if (!sound(motion)) return 1;
        Quaterniond turn = (body.turn * exponential(motion.head<3>() * sim->timestep)).normalized();
        if (body.kind == FREE) {  // the velocities in world axes are DART's
          Matrix3d change = turn.toRotationMatrix().transpose() * body.joint->getRelativeTransform().linear();
          motion.head<3>() = change * Vector3d(motion.head<3>());
          motion.tail<3>() = change * Vector3d(motion.tail<3>());
        }
        body.turn = turn;
        lay(body);
        if (body.kind == FREE) body.joint->setVelocities(motion);
      }
    }
    return 0;
  } catch (const std::exception &error) {
    said = error.what();
    return 2;
  }
}

int gz_tree_count(const Sim *sim) { return static_cast<int>(sim->trees.size()); }

// A tree's coordinates, and their places in v.
int gz_tree(const Sim *sim, int number, int *places) {
  int count = 0;
  for (int index : sim->trees[number].bodies)
    for (int k = 0; k < VELOCITIES[sim->bodies[index].kind]; k++) places[count++] = sim->bodies[index].v + k;
  return count;
}

int gz_tree_size(const Sim *sim, int number) { return sim->trees[number].size; }

// A tree's mass matrix by rows, armature included.
void gz_mass(const Sim *sim, int number, double *found) {
  const Tree &tree = sim->trees[number];
  MatrixXd mass = tree.skeleton->getMassMatrix(), turn = velocity_map(*sim, tree);
  for (int index : tree.bodies) {
    const Body &body = sim->bodies[index];
    for (int k = 0; k < VELOCITIES[body.kind]; k++) mass(body.dof + k, body.dof + k) += body.armature;
  }
  Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(found, tree.size, tree.size) =
      turn.transpose() * mass * turn;
}

// Coriolis, centrifugal and gravity forces (nv).
void gz_bias(const Sim *sim, double *found) {
  for (const auto &tree : sim->trees) {
    if (!tree.size) continue;
    VectorXd change = VectorXd::Zero(tree.size);  // T' v
    bool turning = false;
    for (int index : tree.bodies) {
      const Body &body = sim->bodies[index];
      if (body.kind != FREE) continue;
      VectorXd motion = body.joint->getVelocities();
      change.segment<3>(body.dof + 3) = -Vector3d(motion.head<3>()).cross(Vector3d(motion.tail<3>()));
      turning = true;
    }
    VectorXd bias = tree.skeleton->getCoriolisAndGravityForces();
    if (turning) bias += tree.skeleton->getMassMatrix() * change;
    VectorXd ours = velocity_map(*sim, tree).transpose() * bias;
    int at = 0;
    for (int index : tree.bodies)
      for (int k = 0; k < VELOCITIES[sim->bodies[index].kind]; k++) found[sim->bodies[index].v + k] = ours[at++];
  }
}

// Kinetic and potential energy, armatures and springs included.
void gz_energy(const Sim *sim, double *found) {
  found[0] = found[1] = 0.0;
  for (const auto &tree : sim->trees) {
    found[0] += tree.skeleton->computeKineticEnergy();
    for (const auto *node : tree.skeleton->getBodyNodes())  // DART's own takes links' origins for their centres (measured)
      found[1] -= node->getMass() * tree.skeleton->getGravity().dot(node->getCOM());
    for (int index : tree.bodies) {
      const Body &body = sim->bodies[index];
      if (body.kind == FREE) continue;
      found[0] += 0.5 * body.armature * body.joint->getVelocities().squaredNorm();
      if (body.kind == BALL)
        found[1] += 0.5 * body.stiffness * logarithm(body.turn).squaredNorm();
      else
        found[1] += 0.5 * body.stiffness * std::pow(body.joint->getPosition(0) - body.rest, 2);
    }
  }
}

void gz_no_dry_friction(Sim *sim, int body) { sim->bodies[body].joint->setCoulombFriction(0, 0.0); }
}
