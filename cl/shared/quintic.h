// Where two depths cross: sign changes of a quintic in Bernstein form.
#ifndef MB_QUINTIC_H
#define MB_QUINTIC_H

#define QUINTIC 6

// Coefficients on [low, high] of a quadratic, by blossoming.
static void restrict_quadratic(const double *b, double low, double high, double *out)
{
    double l0 = b[0] + low * (b[1] - b[0]), l1 = b[1] + low * (b[2] - b[1]);
    double h0 = b[0] + high * (b[1] - b[0]), h1 = b[1] + high * (b[2] - b[1]);
    out[0] = l0 + low * (l1 - l0), out[1] = l0 + high * (l1 - l0), out[2] = h0 + high * (h1 - h0);
}

// Likewise of a cubic.
static void restrict_cubic(const double *b, double low, double high, double *out)
{
    double l[3], h[3];
    for (int i = 0; i < 3; i++) {
        l[i] = b[i] + low * (b[i + 1] - b[i]);
        h[i] = b[i] + high * (b[i + 1] - b[i]);
    }
    double ll0 = l[0] + low * (l[1] - l[0]), ll1 = l[1] + low * (l[2] - l[1]);
    double lh0 = l[0] + high * (l[1] - l[0]), lh1 = l[1] + high * (l[2] - l[1]);
    double hh0 = h[0] + high * (h[1] - h[0]), hh1 = h[1] + high * (h[2] - h[1]);
    out[0] = ll0 + low * (ll1 - ll0), out[1] = ll0 + high * (ll1 - ll0);
    out[2] = lh0 + high * (lh1 - lh0), out[3] = hh0 + high * (hh1 - hh0);
}

// Product of a quadratic and a cubic.
static void multiply_to_quintic(const double *q, const double *c, double *out)
{
    out[0] = q[0] * c[0];
    out[1] = 0.4 * (q[1] * c[0]) + 0.6 * (q[0] * c[1]);
    out[2] = 0.1 * (q[2] * c[0]) + 0.6 * (q[1] * c[1]) + 0.3 * (q[0] * c[2]);
    out[3] = 0.3 * (q[2] * c[1]) + 0.6 * (q[1] * c[2]) + 0.1 * (q[0] * c[3]);
    out[4] = 0.6 * (q[2] * c[2]) + 0.4 * (q[1] * c[3]);
    out[5] = q[2] * c[3];
}

// Number of sign changes in the coefficients, zeros left out: a bound of the number of roots.
static int quintic_variations(const double *b)
{
    int count = 0;
    double before = 0.0;
    for (int i = 0; i < QUINTIC; i++) {
        if (b[i] == 0.0) continue;
        count += before != 0.0 && (before < 0.0) != (b[i] < 0.0);
        before = b[i];
    }
    return count;
}

// Coefficients on [0, t] and on [t, 1], by de Casteljau's scheme.
static void split_quintic(const double *b, double t, double *left, double *right)
{
    double c[QUINTIC];
    for (int i = 0; i < QUINTIC; i++) c[i] = b[i];
    for (int k = 0; k < QUINTIC; k++) {
        left[k] = c[0];
        right[QUINTIC - 1 - k] = c[QUINTIC - 1 - k];
        for (int i = 0; i + 1 < QUINTIC - k; i++) c[i] += t * (c[i + 1] - c[i]);
    }
}

static double quintic_at(const double *b, double t)
{
    double c[QUINTIC];
    for (int i = 0; i < QUINTIC; i++) c[i] = b[i];
    for (int k = QUINTIC - 1; k > 0; k--)
        for (int i = 0; i < k; i++) c[i] += t * (c[i + 1] - c[i]);
    return c[0];
}

#define QUINTIC_DEPTH 30 // roots are found to 2^-30

// The only root in (0, 1), where the ends differ in sign: the secant method, with the value of an
// end that stays halved (Illinois).
static double quintic_only_root(const double *b)
{
    double low = 0.0, high = 1.0, at_low = b[0], at_high = b[QUINTIC - 1];
    int stayed = 0;
    for (int i = 0; high - low > 1.0 / (1 << QUINTIC_DEPTH); i++) {
        // Where the ends differ by many orders of magnitude halving does what secants did not.
        double t = i % 8 == 7 || i >= 2 * QUINTIC_DEPTH
                       ? 0.5 * (low + high)
                       : low + (high - low) * (at_low / (at_low - at_high));
        // Keep off the ends, so that the bracket closes from both sides.
        t = clamp(t, low + 0x1p-31, high - 0x1p-31);
        double value = quintic_at(b, t);
        if ((value < 0.0) == (at_low < 0.0)) {
            low = t, at_low = value;
            at_high *= stayed < 0 ? 0.5 : 1.0;
            stayed = -1;
        } else {
            high = t, at_high = value;
            at_low *= stayed > 0 ? 0.5 : 1.0;
            stayed = 1;
        }
    }
    return 0.5 * (low + high);
}

// Times in (0, 1) at which the quintic changes its sign, ascending; returns how many (0 to 5).
// Halving goes on while a part may hold several roots, down to 2^-30; closer ones are none or one.
static int quintic_roots(const double *b, double *roots)
{
    double stack[QUINTIC_DEPTH + 2][QUINTIC], start[QUINTIC_DEPTH + 2], size[QUINTIC_DEPTH + 2];
    int level[QUINTIC_DEPTH + 2], top = 0, count = 0;
    for (int i = 0; i < QUINTIC; i++) stack[0][i] = b[i];
    start[0] = 0.0, size[0] = 1.0, level[0] = 0;
    while (top >= 0) {
        double here[QUINTIC], at = start[top], whole = size[top];
        int depth = level[top];
        for (int i = 0; i < QUINTIC; i++) here[i] = stack[top][i];
        top--;
        int changes = quintic_variations(here);
        if (changes == 0) continue;
        // With a root at an end as well, parts that have none there come from halving.
        bool differ = (here[0] < 0.0 && here[QUINTIC - 1] > 0.0)
                      || (here[0] > 0.0 && here[QUINTIC - 1] < 0.0);
        if ((changes == 1 && differ) || depth == QUINTIC_DEPTH) {
            if (differ && count < 5) roots[count++] = at + whole * quintic_only_root(here);
            continue;
        }
        // Not at a root: neither part would see its sign change.
        double part = 0.5;
        double left[QUINTIC], right[QUINTIC];
        split_quintic(here, part, left, right);
        if (right[0] == 0.0) split_quintic(here, part = 0.484375, left, right);
        for (int i = 0; i < QUINTIC; i++) stack[top + 1][i] = right[i], stack[top + 2][i] = left[i];
        start[top + 1] = at + part * whole, size[top + 1] = (1.0 - part) * whole;
        start[top + 2] = at, size[top + 2] = part * whole;
        level[top + 1] = level[top + 2] = depth + 1;
        top += 2;
    }
    return count;
}

#endif
