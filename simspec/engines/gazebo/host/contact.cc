// Contact: what may touch, what touched, and what DART holds of the shapes.

#include "simspec_gazebo.h"

#include <dart/collision/ode/OdeCollisionGroup.hpp>
#include <dart/constraint/ContactConstraint.hpp>

#include <algorithm>
#include <limits>
#include <set>

using dart::constraint::ContactConstraint;
using Eigen::Map;
using Eigen::Vector3d;

bool Sim::apart(int one, int other) const {
  const Unit &a = units[one], &b = units[other];
  if (a.group == b.group || !meet[static_cast<size_t>(a.kind) * classes + b.kind]) return true;
  if (excluded.empty()) return false;
  long long low = std::min(a.body, b.body), high = std::max(a.body, b.body);
  return std::binary_search(excluded.begin(), excluded.end(), low * static_cast<long long>(bodies.size()) + high);
}

int Sim::unit(const dart::collision::CollisionObject *object) const {
  auto found = unit_of.find(object->getShapeFrame());
  return found == unit_of.end() ? -1 : found->second;
}

bool Filter::ignoresCollision(const dart::collision::CollisionObject *one,
                              const dart::collision::CollisionObject *other) const {
  int a = sim.unit(one), b = sim.unit(other);
  return a < 0 || b < 0 || sim.apart(a, b);
}

// What DART keeps to itself of a group of its detector ode: the space of its library, and the objects in it by their shapes.
struct Inside : dart::collision::OdeCollisionGroup {
  static dSpaceID space(dart::collision::OdeCollisionGroup *group) { return group->*(&Inside::mSpaceId); }
  static dart::collision::CollisionObject *object(dart::collision::CollisionGroup *group, const dart::dynamics::ShapeFrame *of) {
    for (const auto &one : group->*(&Inside::mObjectInfoList))
      if (one->mFrame == of) return one->mObject.get();
    return nullptr;
  }
};

extern "C" {

// Where a hull takes the place of a unit's geom: the space of the detector's library, and what its geom is known by. Null where it is
// another detector.
void *gz_space(Sim *sim) {
  auto *solver = sim->world->getConstraintSolver();
  if (solver->getCollisionDetector()->getType() != "ode") return nullptr;
  return Inside::space(static_cast<dart::collision::OdeCollisionGroup *>(solver->getCollisionGroup().get()));
}

void *gz_object(Sim *sim, int unit) {
  return Inside::object(sim->world->getConstraintSolver()->getCollisionGroup().get(), sim->units[unit].node);
}

// The collision shapes in the world's order, each the one of that name on its body; whatever else collides is an error.
// numbers: body, class, rigid group of each. meet: classes by classes. excluded: sorted keys of pairs of bodies.
int gz_units(Sim *sim, int count, const char **names, const int *numbers, int classes, const char *meet, int pairs,
             const long long *excluded, int most_contacts) {
  try {
    for (int i = 0; i < count; i++) {
      auto *node = sim->bodies[numbers[3 * i]].node;
      std::string name = names[i];
      dart::dynamics::ShapeNode *found = nullptr;
      for (auto *shape : node->getShapeNodesWith<dart::dynamics::CollisionAspect>()) {
        std::string held = shape->getName();
        auto colon = held.rfind(':');
        if ((colon == std::string::npos ? held : held.substr(colon + 1)) == name) found = shape;
      }
      if (!found) {
        said = "gz-physics has no collision shape " + name;
        return -1;
      }
      if (!found->getDynamicsAspect()) {
        said = "gz-physics gave the shape " + name + " no friction";
        return -1;
      }
      sim->unit_of[found] = i;
      sim->units.push_back({found, numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]});
    }
    sim->classes = classes;
    sim->meet.assign(meet, meet + static_cast<size_t>(classes) * classes);
    sim->excluded.assign(excluded, excluded + pairs);
    auto *solver = sim->world->getConstraintSolver();
    if (solver->getCollisionGroup()->getNumShapeFrames() != sim->units.size()) {
      said = "gz-physics has other collision shapes than the text";
      return -1;
    }
    sim->filter = std::make_shared<Filter>(*sim);
    auto &option = solver->getCollisionOption();
    option.collisionFilter = sim->filter;
    option.maxNumContacts = sim->most_contacts = static_cast<size_t>(most_contacts);
    option.enableContact = true;
    ContactConstraint::setErrorReductionParameter(0.01);
    ContactConstraint::setErrorAllowance(0.0);
    ContactConstraint::setMaxErrorReductionVelocity(1e9);
    return 0;
  } catch (const std::exception &error) {
    said = error.what();
    return -1;
  }
}

// The coefficient of restitution of a unit that SDF cannot say.
void gz_restitution(Sim *sim, int unit, double value) {
  sim->units[unit].node->getDynamicsAspect()->setRestitutionCoeff(value);
}

// Whether two units do not touch, for all (units by units).
void gz_excluded(const Sim *sim, unsigned char *found) {
  int count = static_cast<int>(sim->units.size());
  for (int one = 0; one < count; one++)
    for (int other = 0; other < count; other++) *found++ = sim->apart(one, other);
}

void gz_no_contact(Sim *sim) { sim->world->getConstraintSolver()->getCollisionGroup()->removeAllShapeFrames(); }

int gz_contact_count(const Sim *sim) {
  return static_cast<int>(sim->world->getLastCollisionResult().getNumContacts());
}

// The last step's contacts: units (n, 2), and (n, 8) point, normal from the second unit to the first, depth, normal force.
void gz_contacts(const Sim *sim, int *units, double *numbers) {
  for (const auto &contact : sim->world->getLastCollisionResult().getContacts()) {
    units[0] = sim->unit(contact.collisionObject1);
    units[1] = sim->unit(contact.collisionObject2);
    Map<Vector3d>(numbers, 3) = contact.point;
    Map<Vector3d>(numbers + 3, 3) = contact.normal;
    numbers[6] = contact.penetrationDepth;
    numbers[7] = contact.normal.dot(contact.force);
    units += 2;
    numbers += 8;
  }
}

// Pairs of units that touch at the present state: how many there are; those for which there is room are written.
int gz_touching(const Sim *sim, int *pairs, int room) {
  auto *solver = sim->world->getConstraintSolver();
  dart::collision::CollisionOption option = solver->getCollisionOption();
  option.maxNumContacts = std::numeric_limits<int>::max();
  dart::collision::CollisionResult result;
  solver->getCollisionGroup()->collide(option, &result);
  std::set<std::pair<int, int>> found;
  for (const auto &contact : result.getContacts()) {
    int a = sim->unit(contact.collisionObject1), b = sim->unit(contact.collisionObject2);
    found.emplace(std::min(a, b), std::max(a, b));
  }
  int count = 0;
  for (const auto &pair : found) {
    if (count < room) pairs[2 * count] = pair.first, pairs[2 * count + 1] = pair.second;
    count++;
  }
  return count;
}

// --- what is held ---------------------------------------------------------------------------------------------------

// A body: mass, centre 3, moments and products 6, parent's number (-1: world, -2: none of ours), the joint's place in its parent
// 12, in its child 12, axis 3, limits of position 2, velocity 2, acceleration 2, force 2, enforced, dry friction, damping,
// spring, rest, actuator, gravity, collidable, initial command.
enum { BODY = 51 };
int gz_body_numbers() { return BODY; }
void gz_body(const Sim *sim, int number, double *found) {
  const Body &body = sim->bodies[number];
  auto *joint = body.joint;
  std::fill(found, found + BODY, 0.0);
  const auto &inertia = body.node->getInertia();
  auto moment = inertia.getMoment();
  double first[] = {inertia.getMass(), 0, 0, 0, moment(0, 0), moment(1, 1), moment(2, 2), moment(0, 1), moment(0, 2), moment(1, 2)};
  std::copy(first, first + 10, found);
  Map<Vector3d>(found + 1, 3) = inertia.getLocalCOM();
  found[10] = -1.0;
  if (auto *above = body.node->getParentBodyNode()) {
    found[10] = -2.0;
    for (size_t i = 0; i < sim->bodies.size(); i++)
      if (sim->bodies[i].node == above) found[10] = static_cast<double>(i);
  }
  int at = 11;
  for (const auto &place : {joint->getTransformFromParentBodyNode(), joint->getTransformFromChildBodyNode()}) {
    Map<Vector3d>(found + at, 3) = place.translation();
    Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(found + at + 3, 3, 3) = place.linear();
    at += 12;
  }
  if (auto *hinge = dynamic_cast<dart::dynamics::RevoluteJoint *>(joint)) Map<Vector3d>(found + 35, 3) = hinge->getAxis();
  if (auto *slide = dynamic_cast<dart::dynamics::PrismaticJoint *>(joint)) Map<Vector3d>(found + 35, 3) = slide->getAxis();
  if (joint->getNumDofs()) {
    double rest[] = {joint->getPositionLowerLimit(0), joint->getPositionUpperLimit(0), joint->getVelocityLowerLimit(0),
                     joint->getVelocityUpperLimit(0), joint->getForceLowerLimit(0),    joint->getForceUpperLimit(0),
                     static_cast<double>(joint->areLimitsEnforced()), joint->getCoulombFriction(0),
                     joint->getDampingCoefficient(0), joint->getSpringStiffness(0), joint->getRestPosition(0)};
    std::copy(rest, rest + 11, found + 38);
  }
  found[49] = static_cast<double>(joint->getActuatorType());
  found[50] = body.node->getGravityMode() + 2.0 * body.node->isCollidable();
}

// What simspec adds to each joint as efforts: damping, stiffness, rest, armature.
void gz_joint_efforts(const Sim *sim, int number, double *found) {
  const Body &body = sim->bodies[number];
  double own[] = {body.damping, body.stiffness, body.rest, body.armature};
  std::copy(own, own + 4, found);
}

const char *gz_shape_type(const Sim *sim, int number) {
  static std::string held;
  held = sim->units[number].node->getShape()->getType();
  return held.c_str();
}

// A unit: size 3, its place on its body 12, friction, second friction, slip, second slip, restitution, direction of friction 3,
// whether it may collide, whether it is in the solver's group, whether the direction is of a frame.
enum { UNIT = 26 };
int gz_unit_numbers() { return UNIT; }
void gz_unit(const Sim *sim, int number, double *found) {
  std::fill(found, found + UNIT, 0.0);
  auto *node = sim->units[number].node;
  auto *shape = node->getShape().get();
  if (auto *ball = dynamic_cast<dart::dynamics::SphereShape *>(shape)) found[0] = ball->getRadius();
  if (auto *box = dynamic_cast<dart::dynamics::BoxShape *>(shape)) Map<Vector3d>(found, 3) = box->getSize();
  if (auto *round = dynamic_cast<dart::dynamics::CylinderShape *>(shape)) found[0] = round->getRadius(), found[1] = round->getHeight();
  if (auto *round = dynamic_cast<dart::dynamics::CapsuleShape *>(shape)) found[0] = round->getRadius(), found[1] = round->getHeight();
  auto place = node->getRelativeTransform();
  Map<Vector3d>(found + 3, 3) = place.translation();
  Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(found + 6, 3, 3) = place.linear();
  const auto *surface = node->getDynamicsAspect();
  found[15] = surface->getPrimaryFrictionCoeff();
  found[16] = surface->getSecondaryFrictionCoeff();
  found[17] = surface->getPrimarySlipCompliance();
  found[18] = surface->getSecondarySlipCompliance();
  found[19] = surface->getRestitutionCoeff();
  Map<Vector3d>(found + 20, 3) = surface->getFirstFrictionDirection();
  found[23] = node->getCollisionAspect()->isCollidable();
  found[24] = sim->world->getConstraintSolver()->getCollisionGroup()->getNumShapeFrames() > 0;
  found[25] = surface->getFirstFrictionDirectionFrame() != nullptr;
}

// The world: gravity 3, timestep, error reduction, its largest speed, allowance, constraint force mixing, most contacts, whether
// contacts are computed whole, whether simspec's filter is in use, shapes of the solver's group, skeletons, links.
enum { WORLD = 14 };
int gz_world_numbers() { return WORLD; }
void gz_world(const Sim *sim, double *found) {
  Map<Vector3d>(found, 3) = sim->world->getGravity();
  const auto *solver = sim->world->getConstraintSolver();
  const auto &option = solver->getCollisionOption();
  double rest[] = {sim->world->getTimeStep(),
                   ContactConstraint::getErrorReductionParameter(),
                   ContactConstraint::getMaxErrorReductionVelocity(),
                   ContactConstraint::getErrorAllowance(),
                   ContactConstraint::getConstraintForceMixing(),
                   static_cast<double>(option.maxNumContacts),
                   static_cast<double>(option.enableContact),
                   static_cast<double>(option.collisionFilter == sim->filter),
                   static_cast<double>(solver->getCollisionGroup()->getNumShapeFrames()),
                   static_cast<double>(sim->world->getNumSkeletons()),
                   static_cast<double>(sim->named.size())};
  std::copy(rest, rest + 11, found + 3);
}

// Groups of bodies in contact with friction that were solved in passes, and those whose bounds never fitted.
void gz_counts(const Sim *sim, int *counts) {
  counts[0] = sim->coupled ? static_cast<int>(sim->coupled->stepped) : 0;
  counts[1] = sim->coupled ? static_cast<int>(sim->coupled->unsettled) : 0;
}

const char *gz_detector(const Sim *sim) { return sim->detector.c_str(); }
const char *gz_solver(const Sim *sim) { return sim->solver.c_str(); }

// A tree's skeleton: mobile, self collision, adjacent bodies, timestep, gravity 3.
void gz_skeleton(const Sim *sim, int number, double *found) {
  const auto *held = sim->trees[number].skeleton;
  found[0] = held->isMobile();
  found[1] = held->getTimeStep();
  Map<Vector3d>(found + 2, 3) = held->getGravity();
}
}
