// Friction whose bounds follow from the normal forces that it changes. DART's Dantzig bounds friction once, by the normal forces that
// would be without it: a rod that leans on a smooth wall and a clamp that holds itself by its own weight fall. Here each group of
// bodies in contact is solved by Dantzig in passes, each bound by the normal forces of the one before, until they fit.

#include "simspec_gazebo.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace {

const int MOST_PASSES = 20;
const double STEADY = 1e-3;    // share by which friction may miss its law
const double SEED = 0.01;      // of what holds a fall: the bound of what slips without a normal force, for it to grow from
const double LEAST = 1e-5;     // of what holds a fall: what friction may miss its law by
const double SLOW = 1e-6;      // of the speed of a step's fall: what slips less sticks
const double STEEP = 0.9;      // of a change of bounds comes back as one of normal forces: above it, passes get nowhere
const double STEEPEST = 0.98;  // up to which a change of bounds is carried on to where it ends

int padded(int n) { return n > 1 ? ((n - 1) | 3) + 1 : n; }  // the width of the matrix' rows

struct Normal {
  double bound = 0, push = 0, was = 0;
  bool held = false, tried = false, open = false, slips = false;
};

}  // namespace

const std::string &Coupled::getType() const {
  static const std::string type = "DantzigBoxedLcpSolver in passes";
  return type;
}

#ifndef NDEBUG
bool Coupled::canSolve(int n, const double *A) { return direct.canSolve(n, A); }
#endif

bool Coupled::solve(int n, double *A, double *x, double *b, int nub, double *lo, double *hi, int *findex, bool early) {
  std::vector<int> rows;
  for (int k = 0; k < n; k++)
    if (findex[k] >= 0 && findex[k] != k && hi[k] > 0) rows.push_back(k);
  if (rows.empty()) return direct.solve(n, A, x, b, nub, lo, hi, findex, early);

  stepped++;
  const int width = padded(n);
  const std::vector<double> matrix(A, A + static_cast<size_t>(n) * width), right(b, b + n), low(lo, lo + n), high(hi, hi + n);
  const std::vector<int> normals(findex, findex + n);
  std::vector<Normal> normal(n);
  std::vector<double> last(x, x + n);
  for (int pass = 1;; pass++) {
    if (pass > 1) {
      std::copy(matrix.begin(), matrix.end(), A);
      std::copy(right.begin(), right.end(), b);
      std::copy(low.begin(), low.end(), lo);
      std::copy(high.begin(), high.end(), hi);
      std::copy(normals.begin(), normals.end(), findex);
      for (int k : rows) {
        const Normal &of = normal[normals[k]];
        hi[k] = of.held ? std::numeric_limits<double>::infinity() : high[k] * of.bound;
        lo[k] = -hi[k];
        findex[k] = -1;
      }
    }
    if (!direct.solve(n, A, x, b, nub, lo, hi, findex, early)) {
      if (pass == 1) return false;
      std::copy(last.begin(), last.end(), x);
      unsettled++;
      return true;
    }
    std::copy(x, x + n, last.begin());

    for (int k : rows) normal[normals[k]].open = normal[normals[k]].slips = false;
    bool due = false;
    for (int k : rows) {
      Normal &of = normal[normals[k]];
      const double *row = matrix.data() + static_cast<size_t>(k) * width;
      double slip = -right[k], whole = fall / matrix[static_cast<size_t>(normals[k]) * (width + 1)];
      for (int i = 0; i < n; i++) slip += row[i] * x[i];
      double most = high[k] * std::max(0.0, x[normals[k]]), force = std::abs(x[k]), least = LEAST * high[k] * whole;
      bool slips = std::abs(slip) > SLOW * fall;
      if (force > most * (1 + STEADY) + least || (slips && force < most * (1 - STEADY) - least)) of.open = true;
      // what slips without a normal force may be held up by the friction that it would have
      if (pass == 1 && slips && x[normals[k]] < SEED * whole) of.slips = of.open = true, of.bound = SEED * whole;
      due |= of.open;
    }
    if (!due) return true;
    if (pass == MOST_PASSES) {
      unsettled++;
      return true;
    }
    for (size_t i = 0; i < rows.size(); i++) {
      Normal &of = normal[normals[rows[i]]];
      if (i && normals[rows[i]] == normals[rows[i - 1]]) continue;  // its other row
      double push = std::max(0.0, x[normals[rows[i]]]), changed = of.bound - of.was, next = push;
      double slope = pass > 2 && std::abs(changed) > 1e-12 * of.bound ? (push - of.push) / changed : 0;
      if (of.slips) next = of.bound;
      else if (of.open && of.held) of.held = false;
      else if (of.open && !of.tried && push > of.bound && slope > STEEP) of.held = of.tried = true;
      else if (of.open && pass > 3 && slope < STEEPEST) next = of.bound + (push - of.bound) / (1 - slope);
      of.was = of.bound;
      of.bound = std::max(0.0, next);
      of.push = push;
    }
  }
}
