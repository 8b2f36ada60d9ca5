// What the parts in C++ share: a world that gz-physics made of an SDF text, as DART's own objects. Coordinates of a body's joint
// are simspec's: hinge and slide one number, a ball a quaternion w x y z and the angular velocity in the child's axes, a free
// body its position and quaternion, and its velocity in world axes with the angular velocity in its own.
#ifndef SIMSPEC_GAZEBO_H
#define SIMSPEC_GAZEBO_H

#include <dart/collision/collision.hpp>
#include <dart/constraint/DantzigBoxedLcpSolver.hpp>
#include <dart/constraint/constraint.hpp>
#include <dart/dynamics/dynamics.hpp>
#include <dart/simulation/simulation.hpp>

#include <functional>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <unordered_map>
#include <vector>

enum Kind { FIXED, HINGE, SLIDE, BALL, FREE };

struct Body {
  Kind kind;
  dart::dynamics::BodyNode *node;
  dart::dynamics::Joint *joint;
  int tree, q, v, dof;  // places: of its tree, in q, in v, of its first coordinate in DART's skeleton
  double damping, stiffness, rest, armature;
  bool rubs;                 // whether its dry friction has not been taken away
  Eigen::Quaterniond turn;   // of balls and free bodies, as it was last set or advanced
};

struct Tree {
  dart::dynamics::Skeleton *skeleton;
  std::vector<int> bodies;  // those that have coordinates
  bool driven;              // whether a joint of it has efforts of its own
  int size;                 // coordinates
};

struct Unit {
  dart::dynamics::ShapeNode *node;
  int body, kind, group;  // its body, its class in the table of what meets, its rigid group
};

struct Sim;

// What may touch: classes of units that meet, never two of a rigid group, never two of a pair of bodies that is left out.
class Filter : public dart::collision::CollisionFilter {
 public:
  explicit Filter(const Sim &sim) : sim(sim) {}
  bool ignoresCollision(const dart::collision::CollisionObject *one,
                        const dart::collision::CollisionObject *other) const override;

 private:
  const Sim &sim;
};

// Dantzig's solver in passes (friction.cc). fall: the speed (m/s) that gravity gives in a step.
class Coupled : public dart::constraint::BoxedLcpSolver {
 public:
  explicit Coupled(double fall) : fall(fall) {}
  const std::string &getType() const override;
  bool solve(int n, double *A, double *x, double *b, int nub, double *lo, double *hi, int *findex, bool early) override;
#ifndef NDEBUG
  bool canSolve(int n, const double *A) override;
#endif
  long stepped = 0, unsettled = 0;  // groups with friction that were solved; those whose bounds never fitted

 private:
  dart::constraint::DantzigBoxedLcpSolver direct;
  double fall;
};

struct Sim {
  dart::simulation::World *world = nullptr;
  std::function<void()> step;
  std::string detector, solver, log;  // as gz-physics calls them
  std::vector<Body> bodies;
  std::vector<Tree> trees;
  std::vector<Unit> units;
  std::unordered_map<const dart::dynamics::Frame *, int> unit_of;
  std::unordered_map<std::string, dart::dynamics::BodyNode *> named;
  std::vector<char> meet;  // classes by classes
  int classes = 0;
  std::vector<long long> excluded;  // sorted keys of pairs of bodies, the smaller number first
  std::shared_ptr<Filter> filter;
  std::shared_ptr<Coupled> coupled;  // where the solver is Dantzig's
  double timestep = 0.0;
  int nq = 0, nv = 0;
  size_t most_contacts = 0;
  bool fresh = true;  // not stepped yet
  bool apart(int one, int other) const;
  int unit(const dart::collision::CollisionObject *object) const;
};

// The message of the last error.
extern std::string said;

// Keeps what is said on std::cerr while it lives.
struct Quiet {
  Quiet();
  ~Quiet();
  std::ostringstream text;
  std::streambuf *before;
};

// Holds the port of gz-common's profiler while it lives. That begins at a process' first step, would listen on it at all addresses
// for as long as the process lives, and ends with a message where the port is taken.
struct Unprofiled {
  Unprofiled();
  ~Unprofiled();
  int held, before;
};

Eigen::MatrixXd velocity_map(const Sim &sim, const Tree &tree);
Eigen::Vector3d rotation_vector(const Eigen::Quaterniond &turn);
bool sound(const Sim &sim);

#endif
