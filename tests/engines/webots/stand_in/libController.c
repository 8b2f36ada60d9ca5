/* A stand-in for the library of Webots' controllers: functions of robot.h and supervisor.h as its reference manual has them,
   each of which asks the stand-in for Webots (world.py) by one line of text and takes one line for an answer. */
#include <arpa/inet.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

typedef struct Node *WbNodeRef;
typedef struct Field *WbFieldRef;

static FILE *asking, *answers;
static char *line;
static size_t room;
static double vectors[4][9];
static int next;

static const char *ask(const char *format, ...) {
  va_list values;
  va_start(values, format);
  vfprintf(asking, format, values);
  va_end(values);
  fputc('\n', asking);
  fflush(asking);
  if (getline(&line, &room, answers) < 0) {
    fprintf(stderr, "Error: Webots has gone\n");
    exit(1);
  }
  line[strcspn(line, "\n")] = 0;
  return line;
}

static const double *numbers(const char *text) {
  double *found = vectors[next = (next + 1) % 4];
  char *end;
  for (int i = 0; i < 9; i++, text = end) found[i] = strtod(text, &end);
  return found;
}

static long id(const void *reference) { return (long)reference; }
static void *reference(const char *text) { return (void *)atol(text); }
static double number(const char *text) { return atof(text); }

int wb_robot_init() {
  const char *url = getenv("WEBOTS_CONTROLLER_URL");
  int port = 0;
  char name[200] = "";
  if (!url || sscanf(url, "ipc://%d/%199s", &port, name) != 2 || strcmp(name, "simspec%20supervisor")) {
    fprintf(stderr, "Error: no Webots at %s\n", url ? url : "");
    exit(1);
  }
  int channel = socket(AF_INET, SOCK_STREAM, 0);
  struct sockaddr_in there = {.sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
  if (connect(channel, (struct sockaddr *)&there, sizeof there)) {
    fprintf(stderr, "Cannot connect to Webots instance\n");
    exit(1);
  }
  printf("The started controller targets a local instance (ipc protocol) of Webots with port number %d.\n", port);
  asking = fdopen(channel, "w");
  answers = fdopen(dup(channel), "r");
  return 1;
}

int wb_robot_step(int duration) { return atoi(ask("step %d", duration)); }
double wb_robot_get_time() { return number(ask("time")); }
double wb_robot_get_basic_time_step() { return number(ask("timestep")); }

WbNodeRef wb_supervisor_node_get_root() { return reference(ask("root")); }
WbNodeRef wb_supervisor_node_get_from_def(const char *def) { return reference(ask("def %s", def)); }
const char *wb_supervisor_node_get_def(WbNodeRef node) { return ask("label %ld", id(node)); }
const char *wb_supervisor_node_get_type_name(WbNodeRef node) { return ask("type %ld", id(node)); }
int wb_supervisor_node_get_number_of_fields(WbNodeRef node) { return atoi(ask("fields %ld", id(node))); }
WbFieldRef wb_supervisor_node_get_field_by_index(WbNodeRef node, int index) {
  return reference(ask("field %ld %d", id(node), index));
}
const double *wb_supervisor_node_get_position(WbNodeRef node) { return numbers(ask("position %ld", id(node))); }
const double *wb_supervisor_node_get_orientation(WbNodeRef node) { return numbers(ask("orientation %ld", id(node))); }
const double *wb_supervisor_node_get_velocity(WbNodeRef node) { return numbers(ask("velocity %ld", id(node))); }
void wb_supervisor_node_add_force(WbNodeRef node, const double force[3], bool relative) {
  ask("force %ld %.17g %.17g %.17g %d", id(node), force[0], force[1], force[2], relative);
}
void wb_supervisor_node_add_torque(WbNodeRef node, const double torque[3], bool relative) {
  ask("torque %ld %.17g %.17g %.17g %d", id(node), torque[0], torque[1], torque[2], relative);
}

const char *wb_supervisor_field_get_name(WbFieldRef field) { return ask("name %ld", id(field)); }
const char *wb_supervisor_field_get_type_name(WbFieldRef field) { return ask("kind %ld", id(field)); }
int wb_supervisor_field_get_count(WbFieldRef field) { return atoi(ask("count %ld", id(field))); }

#define READ(kind, result, end) \
  result wb_supervisor_field_get_sf_##end(WbFieldRef field) { return kind(ask("value %ld 0", id(field))); } \
  result wb_supervisor_field_get_mf_##end(WbFieldRef field, int index) { return kind(ask("value %ld %d", id(field), index)); }

static const char *text(const char *answer) { return answer; }
READ(atoi, bool, bool)
READ(atoi, int, int32)
READ(number, double, float)
READ(numbers, const double *, vec2f)
READ(numbers, const double *, vec3f)
READ(numbers, const double *, rotation)
READ(numbers, const double *, color)
READ(text, const char *, string)
READ(reference, WbNodeRef, node)
