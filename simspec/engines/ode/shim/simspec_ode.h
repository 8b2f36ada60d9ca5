/* What ODE does not do from Python at speed, and what its joints do not do by themselves: see world.c, motion.c, contact.c, passes.c,
   step.c.
   All lengths in m, kg, s; vectors in world axes unless said. */
#ifndef SIMSPEC_ODE_H
#define SIMSPEC_ODE_H
#include <ode/ode.h>
#include <setjmp.h>

enum { FIXED, HINGE, SLIDE, BALL, FREE };
enum { ELLIPTIC, CIRCUMSCRIBED, INSCRIBED };
enum { MOST_POINTS = 64, TEXT = 200 };
#define STOP_ERP 0.01
#define STOP_CFM 1e-10
#define MOST_SOFTER 1e5
#define NUDGE 1e-13 /* m/s */
#define NUDGES 11 /* that many different ones */
#define UNTIED 1e-10 /* share by which the two bounds of a point differ where points are nudged */
#define MOST_PASSES 20 /* with friction */
#define SAME_NORMAL (1 - 1e-9) /* cosine of the angle, of 45 urad */
#define STEADY 1e-3 /* share by which friction may miss its law */

/* Bodies that touch or are joined, directly or by others, in the present step; data of the first of them. What is missed of a bound is
   the normal force less the bound. */
typedef struct {
  int first;                /* of the group, or nearer to it */
  int regular, disturbed;   /* passes since friction was last held, released or turned; whether it was in this pass */
  double missed, change, back, moved; /* over points: missed times its change, that change squared, and times the change of bounds, and
                                         that squared */
} Group;

/* A body of the world and its joint to what it hangs on. */
typedef struct {
  int kind, parent, q, v;   /* parent -1: the world; q, v: where its coordinates begin */
  int carrier, rigid;       /* the body whose ODE body carries it (-1: it cannot move), and the topmost one it is welded to */
  double origin[3], turn[9], axis[3]; /* the joint's frame in the parent's; the axis in the joint's frame */
  double centre[3];         /* of mass, in the body's frame */
  double damping, stiffness, rest, dry, armature, lower, upper;
  int limited;
  dBodyID body;             /* 0: none */
  dJointID joint, rotor, rub, stop;
  dJointFeedback held, rubbed, stopped; /* what joint, rub and stop did in the last step */
  double p[3], R[9], c[3], w[3], vo[3], al[3], ao[3]; /* pose, centre of mass, velocities, accelerations without those of joints */
  double vc[3], force[3], torque[3];
  double jc[3], jw[3];      /* the centre's and the body's accelerations by those of the joints alone */
  Group group;
} Body;

/* The law of two materials as ODE's contacts take it. */
typedef struct { double friction, restitution, threshold, rolling, torsional, soft_erp, soft_cfm; int collide; } Law;

typedef struct { dGeomID geom; int body, material, group, unit; } Shape;

/* How a direction of friction was turned in the last pass, and by what share of that; 0: not yet. */
typedef struct { double last[3], share; } Turning;

/* A point of contact of the present step. */
typedef struct {
  dContactGeom geom; Shape *one, *two; Law *law; dJointFeedback force;
  double push, bound, was;                  /* normal force of the pass before; that by which friction is bound, and was before */
  double weight;                            /* N, of the lighter body */
  double slip[3], free[3], against[3];      /* of the first against the second: now, without friction, and what friction is laid against */
  double turn[3], spun[3], rolling[3];      /* the same of turning */
  Turning bends, curls;                     /* of sliding and of rolling friction */
  int first;                                /* of the group of its bodies */
  int sliding, rolls, held, tried, locks, told; /* held: friction has no bound in this pass; tried: it had none before; locks: since
                                                   normal forces grow faster than bounds */
} Point;

typedef struct {
  dWorldID world; dSpaceID space; dJointGroupID joints;
  int bodies, nq, nv, materials, groups, shapes, points, room, told;
  Body *body; Law *law; unsigned char *ignored; Shape **shape; Point *point;
  long long *excluded; int excluded_count;
  double *q, *u, *start, timestep;
  int cone, quick, contact, lost, jointed;
  int native;               /* bodies stay where ODE's steps leave them */
  long retries, unsolved, doubtful, unsettled, stepped;
  char text[TEXT]; long messages; jmp_buf trap; int armed;
} Sim;

/* motion.c */
void place(Sim *s, const double *q, const double *u);
void lay(Sim *s);
void take_up(Sim *s);
void find_coordinates(Sim *s);
void load(Sim *s, const double *effort, int joints);
void take(Sim *s, double *u);
void advance_state(Sim *s, const double *u);
void set_motors(Sim *s);
void load_rest(Sim *s, const double *effort, const double *acceleration, double *spare);
void turned(const double *R, const double *x, double *Rx);
void matrix(const double *quaternion, double *R);
void multiply(const double *A, const double *B, double *AB);
void multiply_t(const double *A, const double *x, const double *B, double *Atx, double *AtB);

/* contact.c */
void detect(Sim *s);
void join(Sim *s, int with_friction, double softer, double nudge);
void slips(Sim *s);
double length(const double *x);
int across(const double *n, const double *x, double *t);
int direction(const Sim *s, const Point *p, double *t);
int rubs(const Sim *s, const Law *law);
int excluded(Sim *s, const Shape *one, const Shape *two);

/* passes.c */
void force_on_first(const Point *p, double *f);
void aim(Sim *s);
int aim_again(Sim *s);

/* engines/kit/hulls/hulls.c */
void hulls_start(void);
long hulls_doubted(void);
dGeomID hull_new(dSpaceID space, const double *vertices, int count);
#endif
