// Roots in [0, 1] of polynomials in Bernstein form, in double precision.
//
// Quadratics: the citardauq form for the root that would cancel (Press et al., Numerical
// Recipes 5.6). Higher degrees: the roots of the
// derivative split [0, 1] into monotonic pieces, and bisection finds the root of each.
#ifndef MB_BERNSTEIN_H
#define MB_BERNSTEIN_H

// Value at t of the cubic with coefficients b0..b3, by de Casteljau's scheme.
static double bernstein_cubic(const double *b, double t)
{
    double s = 1.0 - t;
    double c0 = s * b[0] + t * b[1], c1 = s * b[1] + t * b[2], c2 = s * b[2] + t * b[3];
    double d0 = s * c0 + t * c1, d1 = s * c1 + t * c2;
    return s * d0 + t * d1;
}

// Roots of b0 (1-t)^2 + 2 b1 t (1-t) + b2 t^2 strictly inside (0, 1), ascending; returns how many.
// A double root counts as none: the sign does not change there.
static int bernstein_quadratic_roots(double b0, double b1, double b2, double *roots)
{
    double a = (b0 - b1) - (b1 - b2), h = b1 - b0; // a t^2 + 2 h t + b0
    double discriminant = b1 * b1 - b0 * b2;
    if (!(discriminant > 0.0)) return 0;
    double q = -(h + (h < 0.0 ? -1.0 : 1.0) * sqrt(discriminant));
    double r0 = b0 / q, r1 = q / a; // q = 0 only with h = 0 and discriminant = 0
    double low = r0 < r1 ? r0 : r1, high = r0 < r1 ? r1 : r0;
    int count = 0;
    if (a == 0.0) low = r0, high = INFINITY;
    if (low > 0.0 && low < 1.0) roots[count++] = low;
    if (high > 0.0 && high < 1.0) roots[count++] = high;
    return count;
}

// Root of the cubic between low, just after which it is negative or not, and high.
static double bernstein_cubic_bracketed(const double *b, double low, double high, bool negative)
{
    for (int i = 0; i < 60; i++) {
        double middle = 0.5 * (low + high);
        if (middle <= low || middle >= high) break;
        if ((bernstein_cubic(b, middle) < 0.0) == negative) low = middle; else high = middle;
    }
    return 0.5 * (low + high);
}

// Sign just after t = 0 as a number: the first coefficient that is not zero.
static double bernstein_cubic_start(const double *b)
{
    return b[0] != 0.0 ? b[0] : b[1] != 0.0 ? b[1] : b[2] != 0.0 ? b[2] : b[3];
}

// Times in (0, 1) at which the cubic changes its sign, ascending; returns how many (0 to 3).
static int bernstein_cubic_roots(const double *b, double *roots)
{
    double ends[4];
    int pieces = bernstein_quadratic_roots(b[1] - b[0], b[2] - b[1], b[3] - b[2], ends + 1) + 1;
    ends[0] = 0.0;
    ends[pieces] = 1.0;
    int count = 0;
    bool negative = bernstein_cubic_start(b) < 0.0;
    for (int i = 0; i < pieces; i++) {
        double after = i + 1 == pieces ? b[3] : bernstein_cubic(b, ends[i + 1]);
        if (after == 0.0 || (after < 0.0) == negative) continue;
        roots[count++] = bernstein_cubic_bracketed(b, ends[i], ends[i + 1], negative);
        negative = !negative;
    }
    return count;
}

#endif
