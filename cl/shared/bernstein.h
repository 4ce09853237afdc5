// Roots in [0, 1] of polynomials in Bernstein form, in double precision.
//
// Cubics: the roots of the derivative split [0, 1] into monotonic pieces, and bisection finds the
// root of each.
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

// b1^2 - b0 b2, exact but for the last bit (Kahan).
static double bernstein_discriminant(double b0, double b1, double b2)
{
    double product = b0 * b2, rest = fma(b0, b2, -product);
    return fma(b1, b1, -product) - rest;
}

// Keep a root that did not round to an end of [0, 1]. One at 0 changes the sign at once.
static int keep_inner_root(double root, bool *negative, double *roots)
{
    if (root >= 1.0) return 0;
    roots[0] = root;
    if (root > 0.0) return 1;
    *negative = !*negative;
    return 0;
}

// Times strictly inside (0, 1) at which b0 (1-t)^2 + 2 b1 t (1-t) + b2 t^2 changes its sign,
// ascending; returns how many. *negative gets its sign before the first. A double root is no
// change.
//
// With r = t / (1-t) the roots are those of b2 r^2 + 2 b1 r + b0: a negative ratio of the ends
// leaves one positive root, a positive one none or two. Both forms below only add what has one
// sign.
static int bernstein_quadratic_roots(double b0, double b1, double b2, bool *negative, double *roots)
{
    double start = b0 != 0.0 ? b0 : b1 != 0.0 ? b1 : b2, end = b2 != 0.0 ? b2 : b1 != 0.0 ? b1 : b0;
    *negative = start < 0.0;
    if (b0 == 0.0 || b2 == 0.0) { // one root is an end; the other one divides a line
        double c0 = b0 != 0.0 ? b0 : 2.0 * b1, c1 = b2 != 0.0 ? b2 : 2.0 * b1;
        if (!(b0 != 0.0 || b2 != 0.0) || !(c0 < 0.0 ? c1 > 0.0 : c0 > 0.0 && c1 < 0.0)) return 0;
        return keep_inner_root(c0 / (c0 - c1), negative, roots);
    }
    if (start < 0.0) b0 = -b0, b1 = -b1, b2 = -b2;
    if ((start < 0.0) != (end < 0.0)) {
        double root = sqrt(b1 * b1 - b0 * b2); // both terms have one sign: nothing cancels
        double before = b1 >= 0.0 ? b1 + root : b0, after = b1 >= 0.0 ? -b2 : root - b1;
        return keep_inner_root(before / (before + after), negative, roots);
    }
    double discriminant = bernstein_discriminant(b0, b1, b2);
    if (b1 >= 0.0 || !(discriminant > 0.0)) return 0;
    double far = sqrt(discriminant) - b1;
    double first = b0 / (b0 + far), second = far / (far + b2);
    if (!(first < second)) return 0;
    int count = keep_inner_root(first, negative, roots);
    return count + keep_inner_root(second, negative, roots + count);
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
    bool rising;
    int pieces = 1 + bernstein_quadratic_roots(b[1] - b[0], b[2] - b[1], b[3] - b[2], &rising,
                                               ends + 1);
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
