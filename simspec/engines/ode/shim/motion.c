/* Forward kinematics; bodies laid on their joints before a step, with the wrenches that make ODE's step that of the joints'
   coordinates; velocities of the joints from those of the bodies after it. */
#include "simspec_ode.h"
#include <math.h>
#include <string.h>

void turned(const double *R, const double *x, double *Rx) {
  for (int i = 0; i < 3; i++) Rx[i] = R[3 * i] * x[0] + R[3 * i + 1] * x[1] + R[3 * i + 2] * x[2];
}

static void turned_back(const double *R, const double *x, double *Rtx) {
  for (int i = 0; i < 3; i++) Rtx[i] = R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2];
}

void multiply(const double *A, const double *B, double *AB) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) AB[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

void multiply_t(const double *A, const double *x, const double *B, double *Atx, double *AtB) {
  turned_back(A, x, Atx);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) AtB[3 * i + j] = A[i] * B[j] + A[3 + i] * B[3 + j] + A[6 + i] * B[6 + j];
}

void matrix(const double *quaternion, double *R) {
  double n = 0, w, x, y, z;
  for (int i = 0; i < 4; i++) n += quaternion[i] * quaternion[i];
  n = 1 / sqrt(n);
  w = n * quaternion[0], x = n * quaternion[1], y = n * quaternion[2], z = n * quaternion[3];
  R[0] = 1 - 2 * (y * y + z * z), R[1] = 2 * (x * y - w * z), R[2] = 2 * (x * z + w * y);
  R[3] = 2 * (x * y + w * z), R[4] = 1 - 2 * (x * x + z * z), R[5] = 2 * (y * z - w * x);
  R[6] = 2 * (x * z - w * y), R[7] = 2 * (y * z + w * x), R[8] = 1 - 2 * (x * x + y * y);
}

static void cross(const double *a, const double *b, double *c) {
  c[0] = a[1] * b[2] - a[2] * b[1], c[1] = a[2] * b[0] - a[0] * b[2], c[2] = a[0] * b[1] - a[1] * b[0];
}

static void add_cross(const double *a, const double *b, double *c) {
  double ab[3];
  cross(a, b, ab);
  for (int i = 0; i < 3; i++) c[i] += ab[i];
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void exponential(const double *vector, double *q) {
  double angle = sqrt(dot(vector, vector)), share = angle == 0 ? 0.5 : sin(angle / 2) / angle;
  q[0] = cos(angle / 2);
  for (int i = 0; i < 3; i++) q[1 + i] = share * vector[i];
}

/* q after a turn by a rotation vector in its own axes. */
static void turn_by(double *q, const double *vector) {
  double e[4], r[4], n = 0;
  exponential(vector, e);
  r[0] = q[0] * e[0] - dot(q + 1, e + 1);
  cross(q + 1, e + 1, r + 1);
  for (int i = 1; i < 4; i++) r[i] += q[0] * e[i] + e[0] * q[i];
  for (int i = 0; i < 4; i++) n += r[i] * r[i];
  n = (r[0] < 0 ? -1 : 1) / sqrt(n);
  for (int i = 0; i < 4; i++) q[i] = n * r[i];
}

/* Poses and velocities of all bodies, and their accelerations where those of the joints are zero. */
void place(Sim *s, const double *q, const double *u) {
  static const double none[9] = {0}, plain[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  for (int k = 0; k < s->bodies; k++) {
    Body *b = s->body + k;
    const Body *a = b->parent < 0 ? 0 : s->body + b->parent;
    const double *R = a ? a->R : plain, *w = a ? a->w : none, *al = a ? a->al : none;
    double frame[9], own[9], r[3], axis[3], part[3];
    turned(R, b->origin, r);
    multiply(R, b->turn, frame);
    turned(frame, b->axis, axis);
    memcpy(b->w, w, 24), memcpy(b->al, al, 24), memcpy(b->R, frame, 72);
    if (b->kind == FREE) {
      matrix(q + b->q + 3, b->R);
      memcpy(b->p, q + b->q, 24), memcpy(b->vo, u + b->v, 24), memset(b->ao, 0, 24);
      turned(b->R, u + b->v + 3, b->w);
    } else {
      if (b->kind == HINGE) {
        double t[4] = {cos(q[b->q] / 2), 0, 0, 0}, sine = sin(q[b->q] / 2);
        for (int i = 0; i < 3; i++) t[1 + i] = sine * b->axis[i];
        matrix(t, own);
        multiply(frame, own, b->R);
        for (int i = 0; i < 3; i++) part[i] = axis[i] * u[b->v];
      } else if (b->kind == BALL) {
        matrix(q + b->q, own);
        multiply(frame, own, b->R);
        turned(b->R, u + b->v, part);
      } else if (b->kind == SLIDE)
        for (int i = 0; i < 3; i++) r[i] += axis[i] * q[b->q];
      memcpy(b->vo, a ? a->vo : none, 24), memcpy(b->ao, a ? a->ao : none, 24);
      for (int i = 0; i < 3; i++) b->p[i] = (a ? a->p[i] : 0) + r[i];
      double wr[3];
      cross(w, r, wr);
      for (int i = 0; i < 3; i++) b->vo[i] += wr[i];
      add_cross(al, r, b->ao);
      add_cross(w, wr, b->ao);
      if (b->kind == HINGE || b->kind == BALL) {
        for (int i = 0; i < 3; i++) b->w[i] += part[i];
        add_cross(w, part, b->al);
      } else if (b->kind == SLIDE) {
        double slide[3], twice[3];
        for (int i = 0; i < 3; i++) slide[i] = axis[i] * u[b->v], twice[i] = 2 * slide[i], b->vo[i] += slide[i];
        add_cross(w, twice, b->ao);
      }
    }
    turned(b->R, b->centre, r);
    cross(b->w, r, b->vc);
    for (int i = 0; i < 3; i++) b->c[i] = b->p[i] + r[i], b->vc[i] += b->vo[i];
  }
}

/* Put ODE's bodies where place has them. */
void lay(Sim *s) {
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    if (!b->body) continue;
    dMatrix3 R = {b->R[0], b->R[1], b->R[2], 0, b->R[3], b->R[4], b->R[5], 0, b->R[6], b->R[7], b->R[8], 0};
    dBodySetPosition(b->body, b->c[0], b->c[1], b->c[2]);
    dBodySetRotation(b->body, R);
    dBodySetLinearVel(b->body, b->vc[0], b->vc[1], b->vc[2]);
    dBodySetAngularVel(b->body, b->w[0], b->w[1], b->w[2]);
  }
}

/* Poses and velocities of all bodies as ODE has them; what has no body of ODE's is where its parent's carries it. */
void take_up(Sim *s) {
  static const double none[9] = {0}, plain[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  for (int k = 0; k < s->bodies; k++) {
    Body *b = s->body + k;
    const Body *a = b->parent < 0 ? 0 : s->body + b->parent;
    double r[3], wr[3];
    if (b->body) {
      const dReal *R = dBodyGetRotation(b->body), *w = dBodyGetAngularVel(b->body);
      for (int i = 0; i < 3; i++) memcpy(b->R + 3 * i, R + 4 * i, 24);
      memcpy(b->c, dBodyGetPosition(b->body), 24), memcpy(b->vc, dBodyGetLinearVel(b->body), 24), memcpy(b->w, w, 24);
      turned(b->R, b->centre, r);
      cross(b->w, r, wr);
      for (int i = 0; i < 3; i++) b->p[i] = b->c[i] - r[i], b->vo[i] = b->vc[i] - wr[i];
      continue;
    }
    turned(a ? a->R : plain, b->origin, r);
    multiply(a ? a->R : plain, b->turn, b->R);
    memcpy(b->w, a ? a->w : none, 24);
    cross(b->w, r, wr);
    for (int i = 0; i < 3; i++) b->p[i] = (a ? a->p[i] : 0) + r[i], b->vo[i] = (a ? a->vo[i] : 0) + wr[i];
    turned(b->R, b->centre, r);
    cross(b->w, r, wr);
    for (int i = 0; i < 3; i++) b->c[i] = b->p[i] + r[i], b->vc[i] = b->vo[i] + wr[i];
  }
}

/* The joints' coordinates nearest to where take_up found the bodies. */
void find_coordinates(Sim *s) {
  static const double none[3] = {0}, plain[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  take(s, s->u);
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k, *a = b->parent < 0 ? 0 : s->body + b->parent;
    double frame[9], away[3], ignored[3], own[9], r[3], axis[3], *q = s->q + b->q;
    if (!b->body || b->kind == FIXED) continue;
    multiply(a ? a->R : plain, b->turn, frame);
    multiply_t(frame, none, b->R, ignored, own);
    dMatrix3 turn = {own[0], own[1], own[2], 0, own[3], own[4], own[5], 0, own[6], own[7], own[8], 0};
    dQuaternion held;
    dQfromR(held, turn);
    double sign = held[0] < 0 ? -1 : 1;
    if (b->kind == FREE) {
      const dReal *whole = dBodyGetQuaternion(b->body);
      memcpy(q, b->p, 24);
      for (int i = 0; i < 4; i++) q[3 + i] = whole[0] < 0 ? -whole[i] : whole[i];
    } else if (b->kind == BALL)
      for (int i = 0; i < 4; i++) q[i] = sign * held[i];
    else if (b->kind == HINGE) {
      double angle = 2 * atan2(dot(b->axis, held + 1), held[0]);
      q[0] += remainder(angle - q[0], 2 * acos(-1));
    } else {
      turned(a ? a->R : plain, b->origin, r);
      turned(frame, b->axis, axis);
      for (int i = 0; i < 3; i++) away[i] = b->p[i] - (a ? a->p[i] : 0) - r[i];
      q[0] = dot(axis, away);
    }
  }
}

static void own_inertia(const Body *b, const double *x, double *Ix) {
  dMass m;
  dBodyGetMass(b->body, &m);
  double local[3], held[3];
  turned_back(b->R, x, local);
  for (int i = 0; i < 3; i++) held[i] = m.I[4 * i] * local[0] + m.I[4 * i + 1] * local[1] + m.I[4 * i + 2] * local[2];
  turned(b->R, held, Ix);
}

/* Wrenches of one step: those of the frames' own accelerations, -m a and -I alpha - omega x I omega, efforts, and
   where joints is not 0 springs and dampers. */
void load(Sim *s, const double *effort, int joints) {
  for (int k = 0; k < s->bodies; k++) {
    Body *b = s->body + k;
    memset(b->force, 0, 24), memset(b->torque, 0, 24);
    if (!b->body || (s->native && joints)) continue;
    double r[3], wr[3], a[3], Ia[3], Iw[3], wIw[3];
    dMass m;
    dBodyGetMass(b->body, &m);
    turned(b->R, b->centre, r);
    cross(b->w, r, wr);
    memcpy(a, b->ao, 24);
    add_cross(b->al, r, a);
    add_cross(b->w, wr, a);
    own_inertia(b, b->al, Ia), own_inertia(b, b->w, Iw);
    cross(b->w, Iw, wIw);
    for (int i = 0; i < 3; i++) b->force[i] = -m.mass * a[i], b->torque[i] = -Ia[i] - wIw[i];
  }
  for (int k = 0; k < s->bodies; k++) {
    Body *b = s->body + k;
    if (!b->body || b->kind == FIXED) continue;
    Body *a = b->parent < 0 || s->body[b->parent].carrier < 0 ? 0 : s->body + s->body[b->parent].carrier;
    double given[6] = {0}, F[3] = {0}, T[3] = {0}, axis[3], frame[3];
    int wide = b->kind == FREE ? 6 : b->kind == BALL ? 3 : 1;
    for (int i = 0; i < wide; i++) given[i] = (effort ? effort[b->v + i] : 0) - (b->kind == FREE || !joints ? 0 : b->damping * s->u[b->v + i]);
    if (b->kind == FREE) {
      memcpy(F, given, 24);
      turned(b->R, given + 3, T);
    } else if (b->kind == BALL) {
      if (b->stiffness && joints) {
        const double *q = s->q + b->q;
        double sign = q[0] < 0 ? -1 : 1, sine = sqrt(dot(q + 1, q + 1));
        double factor = sine > 0 ? 2 * atan2(sine, sign * q[0]) / sine : 2;
        for (int i = 0; i < 3; i++) given[i] -= b->stiffness * sign * factor * q[1 + i];
      }
      turned(b->R, given, T);
    } else {
      if (joints) given[0] -= b->stiffness * (s->q[b->q] - b->rest);
      turned(b->turn, b->axis, frame);
      turned(b->parent < 0 ? (const double[]){1, 0, 0, 0, 1, 0, 0, 0, 1} : s->body[b->parent].R, frame, axis);
      for (int i = 0; i < 3; i++) *(b->kind == HINGE ? T + i : F + i) = axis[i] * given[0];
    }
    for (int i = 0; i < 3; i++) b->force[i] += F[i], b->torque[i] += T[i];
    if (!a || b->kind == FREE) continue;
    double away[3] = {b->c[0] - a->c[0], b->c[1] - a->c[1], b->c[2] - a->c[2]}, moment[3];
    cross(away, F, moment);
    for (int i = 0; i < 3; i++) a->force[i] -= F[i], a->torque[i] -= T[i] + moment[i];
  }
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    if (!b->body) continue;
    dBodyAddForce(b->body, b->force[0], b->force[1], b->force[2]);
    dBodyAddTorque(b->body, b->torque[0], b->torque[1], b->torque[2]);
  }
}

/* Rows of armature, A (u' - u)/dt as a motor's softness, of dry friction, a motor of speed 0, and of stops, u' >= -gap/dt. */
void set_motors(Sim *s) {
  for (int k = 0; k < s->bodies; k++) {
    Body *b = s->body + k;
    void (*set)(dJointID, int, dReal) = b->kind == HINGE ? dJointSetAMotorParam : dJointSetLMotorParam;
    if (b->joint) dJointSetFeedback(b->joint, &b->held);
    if (b->rotor) {
      set(b->rotor, dParamFMax, dInfinity);
      set(b->rotor, dParamVel, s->u[b->v]);
      set(b->rotor, dParamCFM, s->timestep / b->armature);
    }
    if (b->rub) {
      dJointSetFeedback(b->rub, &b->rubbed);
      set(b->rub, dParamFMax, b->dry);
      set(b->rub, dParamVel, 0);
    }
    if (!b->stop) continue;
    /* ODE stops what is beyond a limit, so the limit is laid beyond the joint: by the gap, which a negative ERP gives as speed */
    double below = s->q[b->q] - b->lower, above = b->upper - s->q[b->q], gap = below < above ? below : above;
    double reach = fabs(gap), erp = gap < 0 ? STOP_ERP : -1;
    if (b->stop != b->joint) dJointSetFeedback(b->stop, &b->stopped);
    set = b->kind == HINGE ? dJointSetAMotorParam : dJointSetSliderParam;
    double at = b->kind == HINGE ? 0 : dJointGetSliderPosition(b->stop);
    if (b->kind == HINGE) dJointSetAMotorAngle(b->stop, 0, 0);
    set(b->stop, dParamHiStop, dInfinity);
    set(b->stop, dParamLoStop, -dInfinity);
    if (below < above) set(b->stop, dParamLoStop, at + reach);
    else set(b->stop, dParamHiStop, at - reach);
    set(b->stop, dParamStopERP, erp);
    set(b->stop, dParamStopCFM, STOP_CFM);
  }
}

static void push(const dJointFeedback *held, Body *b, Body *a) {
  for (int i = 0; i < 3; i++) b->force[i] += held->f1[i], b->torque[i] += held->t1[i];
  for (int i = 0; a && i < 3; i++) a->force[i] += held->f2[i], a->torque[i] += held->t2[i];
}

/* The wrenches that a solved step leaves over: bodies at rest where they were laid, with the loads of the step, what the joints
   did in it, and the reaction to the accelerations of the joints (nv,) that came out; stops and dry friction are given as they
   were. Of these almost nothing is left: what ODE's next step of them gives for speeds is what the first one was off by, since
   it solves for the forces in all joints, and round-off grows with them. spare: (nv,). */
void load_rest(Sim *s, const double *effort, const double *acceleration, double *spare) {
  place(s, s->q, acceleration);
  for (int k = 0; k < s->bodies; k++) {
    Body *b = s->body + k;
    memcpy(b->jc, b->vc, 24), memcpy(b->jw, b->w, 24);
  }
  place(s, s->q, s->u);
  for (int i = 0; i < s->nv; i++) spare[i] = effort ? effort[i] : 0;
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    if (b->rotor) spare[b->v] -= b->armature * acceleration[b->v];
  }
  load(s, spare, 1);
  for (int k = 0; k < s->bodies; k++) {
    Body *b = s->body + k;
    if (b->body) memset(b->force, 0, 24), memset(b->torque, 0, 24);
  }
  for (int k = 0; k < s->bodies; k++) {
    Body *b = s->body + k, *a = b->parent < 0 || s->body[b->parent].carrier < 0 ? 0 : s->body + s->body[b->parent].carrier;
    if (!b->body) continue;
    dMass m;
    double Ia[3];
    dBodyGetMass(b->body, &m);
    own_inertia(b, b->jw, Ia);
    for (int i = 0; i < 3; i++) b->force[i] -= m.mass * b->jc[i], b->torque[i] -= Ia[i];
    if (b->joint) push(&b->held, b, a);
    if (b->rub) push(&b->rubbed, b, a);
    if (b->stop && b->stop != b->joint) push(&b->stopped, b, a);
  }
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    if (!b->body) continue;
    dBodySetLinearVel(b->body, 0, 0, 0);
    dBodySetAngularVel(b->body, 0, 0, 0);
    dBodyAddForce(b->body, b->force[0], b->force[1], b->force[2]);
    dBodyAddTorque(b->body, b->torque[0], b->torque[1], b->torque[2]);
  }
}

/* The velocities of the joints, from those of ODE's bodies, on the axes of before the step. */
void take(Sim *s, double *u) {
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    if (!b->body || b->kind == FIXED) continue;
    const dReal *v = dBodyGetLinearVel(b->body), *w = dBodyGetAngularVel(b->body);
    const Body *a = b->parent < 0 || s->body[b->parent].carrier < 0 ? 0 : s->body + s->body[b->parent].carrier;
    if (b->kind == FREE) {
      double r[3], wr[3];
      turned(b->R, b->centre, r);
      cross(w, r, wr);
      for (int i = 0; i < 3; i++) u[b->v + i] = v[i] - wr[i];
      turned_back(b->R, w, u + b->v + 3);
      continue;
    }
    double turn[3] = {w[0], w[1], w[2]}, axis[3], frame[3];
    const dReal *av = 0, *aw = 0;
    if (a) {
      av = dBodyGetLinearVel(a->body), aw = dBodyGetAngularVel(a->body);
      for (int i = 0; i < 3; i++) turn[i] -= aw[i];
    }
    if (b->kind == BALL) {
      turned_back(b->R, turn, u + b->v);
      continue;
    }
    turned(b->turn, b->axis, frame);
    turned(b->parent < 0 ? (const double[]){1, 0, 0, 0, 1, 0, 0, 0, 1} : s->body[b->parent].R, frame, axis);
    if (b->kind == HINGE)
      u[b->v] = dot(axis, turn);
    else {
      double r[3] = {b->p[0] - b->c[0], b->p[1] - b->c[1], b->p[2] - b->c[2]}, moved[3];
      cross(w, r, moved);
      for (int i = 0; i < 3; i++) moved[i] += v[i];
      if (a) {
        double ar[3] = {b->p[0] - a->c[0], b->p[1] - a->c[1], b->p[2] - a->c[2]}, arm[3];
        cross(aw, ar, arm);
        for (int i = 0; i < 3; i++) moved[i] -= av[i] + arm[i];
      }
      u[b->v] = dot(axis, moved);
    }
  }
}

void advance_state(Sim *s, const double *u) {
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    double *q = s->q + b->q, turn[3];
    if (b->kind == HINGE || b->kind == SLIDE) q[0] += s->timestep * u[b->v];
    if (b->kind == FREE)
      for (int i = 0; i < 3; i++) q[i] += s->timestep * u[b->v + i];
    if (b->kind != BALL && b->kind != FREE) continue;
    for (int i = 0; i < 3; i++) turn[i] = s->timestep * u[b->v + (b->kind == FREE ? 3 : 0) + i];
    turn_by(q + (b->kind == FREE ? 3 : 0), turn);
  }
  memcpy(s->u, u, s->nv * sizeof(double));
}
