// Loading: an SDF text through libsdformat and gz-physics, with the plugin of its engine dartsim. What gz-physics made is then
// held as DART's own objects, which it hands out (RetrieveWorld). Nothing of gz-physics is ever taken down: unloading the
// plugin frees twice (measured, 5.1), so that plugin and engine stay until the process ends.

#include "simspec_gazebo.h"

#include <ignition/physics/ForwardStep.hh>
#include <ignition/physics/GetEntities.hh>
#include <ignition/physics/RequestEngine.hh>
#include <ignition/physics/World.hh>
#include <ignition/physics/config.hh>
#include <ignition/physics/dartsim/World.hh>
#include <ignition/physics/sdf/ConstructWorld.hh>
#include <ignition/plugin/Loader.hh>
#include <sdf/Console.hh>
#include <sdf/Root.hh>
#include <sdf/World.hh>

#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>

namespace physics = ignition::physics;

struct Features
    : physics::FeatureList<physics::ForwardStep, physics::GetEntities, physics::sdf::ConstructSdfWorld,
                           physics::CollisionDetector, physics::Solver, physics::dartsim::RetrieveWorld> {};

std::string said;

Quiet::Quiet() : before(std::cerr.rdbuf(text.rdbuf())) {}
Quiet::~Quiet() { std::cerr.rdbuf(before); }

Unprofiled::Unprofiled() : held(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  const char *told = std::getenv("RMT_PORT");  // as the profiler reads it
  sockaddr_in place{};
  place.sin_family = AF_INET;
  place.sin_addr.s_addr = htonl(INADDR_ANY);
  place.sin_port = htons(static_cast<unsigned short>(told ? std::atoi(told) : 17815));
  // where somebody else has the port, the profiler does not get it either, and says so past std::cerr
  if (held >= 0) (void)!bind(held, reinterpret_cast<sockaddr *>(&place), sizeof place);
  int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
  std::fflush(stderr);
  before = dup(STDERR_FILENO);
  if (before >= 0 && nowhere >= 0) dup2(nowhere, STDERR_FILENO);
  if (nowhere >= 0) close(nowhere);
}

Unprofiled::~Unprofiled() {
  std::fflush(stderr);
  if (before >= 0) {
    dup2(before, STDERR_FILENO);
    close(before);
  }
  if (held >= 0) close(held);
}

namespace {

ignition::plugin::PluginPtr *plugin = nullptr;
ignition::plugin::Loader *loader = nullptr;

bool instantiate() {
  const std::string file = IGNITION_PHYSICS_ENGINE_INSTALL_DIR "/libignition-physics-dartsim-plugin.so";
  if (plugin) return true;
  if (!loader) loader = new ignition::plugin::Loader();
  auto names = loader->LoadLib(file);
  if (names.empty()) {
    said = "the plugin " + file + " does not load";
    return false;
  }
  for (const auto &name : names) {
    auto made = loader->Instantiate(name);
    if (!made || !physics::RequestEngine3d<Features>::MissingFeatureNames(made).empty()) continue;
    plugin = new ignition::plugin::PluginPtr(made);
    return true;
  }
  said = "the plugin " + file + " lacks features:";
  for (const auto &name : physics::RequestEngine3d<Features>::MissingFeatureNames(loader->Instantiate(*names.begin())))
    said += " " + name;
  return false;
}

}  // namespace

extern "C" {

const char *gz_said() { return said.c_str(); }

// A world made from an SDF text; null where something is refused (gz_said).
Sim *gz_load(const char *text, double timestep, const char *detector, const char *solver) {
  try {
    Quiet quiet;
    if (!instantiate()) return nullptr;
    sdf::Console::Instance()->SetQuiet(true);
    sdf::Root root;
    auto errors = root.LoadSdfString(text);
    if (!errors.empty()) {
      said = "libsdformat refuses the text: " + errors[0].Message();
      return nullptr;
    }
    if (root.WorldCount() != 1) {
      said = "the text has no world";
      return nullptr;
    }
    auto engine = physics::RequestEngine3d<Features>::From(*plugin);
    if (!engine) {
      said = "gz-physics gives no engine";
      return nullptr;
    }
    auto world = engine->ConstructWorld(*root.WorldByIndex(0));
    if (!world) {
      said = "gz-physics makes no world of the text";
      return nullptr;
    }
    world->SetCollisionDetector(detector);
    world->SetSolver(solver);
    auto *sim = new Sim();
    sim->detector = world->GetCollisionDetector();
    sim->solver = world->GetSolver();
    auto dart_world = world->GetDartsimWorld();
    sim->world = dart_world.get();
    sim->world->setTimeStep(timestep);
    sim->timestep = timestep;
    auto *boxed = dynamic_cast<dart::constraint::BoxedLcpConstraintSolver *>(sim->world->getConstraintSolver());
    if (std::string(solver) == "dantzig") {
      if (!boxed || !boxed->getBoxedLcpSolver()->is<dart::constraint::DantzigBoxedLcpSolver>()) {
        said = "gz-physics has another solver than Dantzig's";
        return nullptr;
      }
      sim->coupled = std::make_shared<Coupled>(sim->world->getGravity().norm() * timestep);
      boxed->setBoxedLcpSolver(sim->coupled);
    }
    if (boxed) sim->solver = boxed->getBoxedLcpSolver()->getType();
    auto input = std::make_shared<physics::ForwardStep::Input>();
    auto state = std::make_shared<physics::ForwardStep::State>();
    auto output = std::make_shared<physics::ForwardStep::Output>();
    sim->step = [world, input, state, output, dart_world]() { world->Step(*output, *state, *input); };
    for (size_t k = 0; k < sim->world->getNumSkeletons(); k++)
      for (auto *node : sim->world->getSkeleton(k)->getBodyNodes()) {
        if (!sim->named.emplace(node->getName(), node).second) {
          said = "gz-physics has two links called " + node->getName();
          return nullptr;
        }
      }
    sim->log = quiet.text.str();
    return sim;
  } catch (const std::exception &error) {
    said = error.what();
    return nullptr;
  }
}

// What gz-physics and libsdformat said while they loaded.
const char *gz_log(const Sim *sim) { return sim->log.c_str(); }

void gz_free(Sim *sim) { delete sim; }
}
