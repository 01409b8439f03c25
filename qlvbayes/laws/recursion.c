/* The recursion of the hereditary integral (laws/hereditary.py), for many columns at once.

   A column is one test under one set of constants. Each relaxing mode obeys
       q(t + h) = e^{-a} q(t) + int_0^1 e^{-a (1 - s)} dF/ds ds,   a = v h,
   where F is the elastic force along one step, s from 0 to 1. The integral is taken of
       dF/ds = p0 + p1 s + p2 s^2 + (a part that is exponential in s, from k0 to k1 = k0 e^g).
   Neighbouring columns mostly share a, so that its exponential is computed once for them.  */

#include <math.h>
#include <stddef.h>

#ifdef _WIN32
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED
#endif

/* M_n = int_0^1 s^n e^{-a (1 - s)} ds = sum_k n!/(n + k + 1)! (-a)^k for n = 0, 1, 2; e is e^{-a} */
static void moments(double a, double e, double *m)
{
    /* 2/(k + 3)!: the term left out is below 1e-16 of M_2 */
    static const double terms[12] = {
        2.0 / 6, 2.0 / 24, 2.0 / 120, 2.0 / 720, 2.0 / 5040, 2.0 / 40320, 2.0 / 362880,
        2.0 / 3628800, 2.0 / 39916800, 2.0 / 479001600, 2.0 / 6227020800, 2.0 / 87178291200};
    if (a < 0.3) {
        int k = a < 1e-3 ? 4 : a < 0.03 ? 7 : 11;
        double sum = terms[k];
        while (k-- > 0)
            sum = terms[k] - a * sum;
        m[2] = sum;
        m[1] = 0.5 * (1.0 - a * m[2]);
        m[0] = 1.0 - a * m[1];
    } else {
        double inverse = 1.0 / a;
        m[0] = (1.0 - e) * inverse;
        m[1] = (1.0 - m[0]) * inverse;
        m[2] = (1.0 - 2.0 * m[1]) * inverse;
    }
}

/* (e^x - 1)/x for abs(x) < 0.04, to 1e-16 */
static double slope_series(double x)
{
    return 1.0 + x * (1.0 / 2 + x * (1.0 / 6 + x * (1.0 / 24 + x * (1.0 / 120 + x * (1.0 / 720
           + x * (1.0 / 5040 + x / 40320))))));
}

/* Adds the relaxing modes to the force (points, sums), given c0 F in it.
   A sum has shares of its own in the states of one column: those of ``source`` (sums), or of the
   column of its own number if that is null.
   lasting (points, columns): h; rates (modes, columns); shares (modes, sums): c;
   powers arrays p (points, columns), at most 3; grown, begun, ended (points, columns): g, k0, k1,
   the last two times the travel of the step, or null; given (modes, points, columns): integrals
   that are known already, or null; state (columns): scratch.  */
EXPORTED void add_modes(size_t points, size_t columns, size_t sums, size_t modes,
                        const double *lasting, const double *rates, const double *shares,
                        int powers, const double *p0, const double *p1, const double *p2,
                        const double *grown, const double *begun, const double *ended,
                        const double *given, const size_t *source, double *state, double *force)
{
    for (size_t l = 0; l < modes; l++) {
        const double *v = rates + l * columns, *c = shares + l * sums;
        for (size_t j = 0; j < columns; j++)
            state[j] = 0.0;
        for (size_t n = 0; n < points; n++) {
            size_t row = n * columns;
            double known = -1.0, e = 1.0, m[3] = {1.0, 0.5, 1.0 / 3.0};
            for (size_t j = 0; j < columns; j++) {
                size_t i = row + j;
                double a = v[j] * lasting[i], step = 0.0;
                if (a != known) {
                    e = exp(-a);
                    if (powers)
                        moments(a, e, m);
                    known = a;
                }
                if (given)
                    step = given[l * points * columns + i];
                if (powers > 0)
                    step += p0[i] * m[0];
                if (powers > 1)
                    step += p1[i] * m[1];
                if (powers > 2)
                    step += p2[i] * m[2];
                if (grown) {
                    double gap = grown[i] + a, first = begun[i] * e;
                    if (fabs(gap) < 0.04)
                        step += first * slope_series(gap);
                    else
                        step += (ended[i] - first) / gap;
                }
                state[j] = e * state[j] + step;
            }
            double *sum = force + n * sums;
            if (source)
                for (size_t j = 0; j < sums; j++)
                    sum[j] += c[j] * state[source[j]];
            else
                for (size_t j = 0; j < sums; j++)
                    sum[j] += c[j] * state[j];
        }
    }
}

/* A curve of pieces of equal width, a parabola each: c0 + b (c1 + c2 b), b from where one begins.
   The first piece lies before zero, and the last has no end.
   depth (rows, sets), or (rows) where ``own`` is 0; c0, c1, c2 (pieces, sets); value (rows, sets). */
EXPORTED void in_pieces(size_t rows, size_t sets, size_t pieces, int own, double width,
                        const double *depth, const double *c0, const double *c1, const double *c2,
                        double *value)
{
    double last = (double)pieces - 2.0;
    for (size_t r = 0; r < rows; r++)
        for (size_t k = 0; k < sets; k++) {
            double d = own ? depth[r * sets + k] : depth[r], knot = floor(d / width);
            knot = knot > last ? last : knot >= -1.0 ? knot : -1.0; /* of a NaN too */
            double b = d - (knot > 0.0 ? knot : 0.0) * width;
            size_t i = (size_t)(knot + 1.0) * sets + k;
            value[r * sets + k] = c0[i] + b * (c1[i] + c2[i] * b);
        }
}

static double drain_rate(double q, double tau, double n, double stroke, double none)
{
    return pow(fmax(fabs(q) / stroke, none), n - 1.0) / tau;
}

/* The pressure of a fluid that drains as a power of itself (effects/fluids.py, ``_drained``).
   step, jump, source, balance, settling (points, columns); tau, n, stroke (columns);
   none, near, low, high: bounds; pressed (points + 1, columns): q, from 0.  */
EXPORTED void drain(size_t points, size_t columns, const double *step, const double *jump,
                    const double *source, const double *balance, const double *settling,
                    const double *tau, const double *n, const double *stroke, double none,
                    double near, double low, double high, double *pressed)
{
    for (size_t j = 0; j < columns; j++)
        pressed[j] = 0.0;
    for (size_t p = 0; p < points; p++)
        for (size_t j = 0; j < columns; j++) {
            size_t i = p * columns + j;
            double q = pressed[i] + jump[i], gap = q - balance[i];
            double relative = drain_rate(q, tau[j], n[j], stroke[j], none), secant, power = 1.0;
            if (fabs(gap) <= near * (fabs(q) + fabs(balance[i])))
                secant = n[j] * drain_rate(0.5 * (q + balance[i]), tau[j], n[j], stroke[j], none);
            else
                secant = (relative * q - source[i]) / gap;
            double excess = secant - settling[i];
            if (fabs(excess) > near * secant)
                power = (n[j] * relative - secant) / excess;
            power = power < low ? low : power > high ? high : power;
            double slower = -power * settling[i] * step[i];
            double slope = slower == 0.0 ? 1.0 : expm1(slower) / slower;
            double grown = power * excess * step[i] * slope;
            double decay = settling[i] * step[i] + log1p(grown) / power;
            double share = secant > 0.0 ? -expm1(-decay) / secant : step[i];
            pressed[i + columns] = q + (source[i] - relative * q) * share;
        }
}
