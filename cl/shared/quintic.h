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

// Halve [0, 1]: coefficients on each half, by de Casteljau's scheme.
static void split_quintic(const double *b, double *left, double *right)
{
    double c[QUINTIC];
    for (int i = 0; i < QUINTIC; i++) c[i] = b[i];
    for (int k = 0; k < QUINTIC; k++) {
        left[k] = c[0];
        right[QUINTIC - 1 - k] = c[QUINTIC - 1 - k];
        for (int i = 0; i + 1 < QUINTIC - k; i++) c[i] = 0.5 * (c[i] + c[i + 1]);
    }
}

#define QUINTIC_DEPTH 30

// Times in (0, 1) at which the quintic changes its sign, ascending; returns how many (0 to 5).
// Halving goes on while a half may hold a root, down to 2^-30; two roots closer than that are none.
static int quintic_roots(const double *b, double *roots)
{
    double stack[QUINTIC_DEPTH + 2][QUINTIC], start[QUINTIC_DEPTH + 2];
    int level[QUINTIC_DEPTH + 2], top = 0, count = 0;
    for (int i = 0; i < QUINTIC; i++) stack[0][i] = b[i];
    start[0] = 0.0, level[0] = 0;
    while (top >= 0) {
        double here[QUINTIC], at = start[top];
        int depth = level[top];
        for (int i = 0; i < QUINTIC; i++) here[i] = stack[top][i];
        top--;
        int changes = quintic_variations(here);
        if (changes == 0) continue;
        double size = 1.0 / (double)(1ul << depth);
        if (depth == QUINTIC_DEPTH) {
            if ((changes & 1) && count < 5) roots[count++] = at + 0.5 * size;
            continue;
        }
        double left[QUINTIC], right[QUINTIC];
        split_quintic(here, left, right);
        top++;
        for (int i = 0; i < QUINTIC; i++) stack[top][i] = right[i];
        start[top] = at + 0.5 * size, level[top] = depth + 1;
        top++;
        for (int i = 0; i < QUINTIC; i++) stack[top][i] = left[i];
        start[top] = at, level[top] = depth + 1;
    }
    return count;
}

#endif
