/* Inverse dynamics of a tree of revolute and prismatic joints (recursive Newton-Euler).

   Eight samples go through the recursion side by side, one in each lane of a vector. Lanes never
   meet, and nothing is contracted to fused multiply-adds (-ffp-contract=off), so a sample gives the
   same bits in every block and on every processor.

   Frames: that of a joint lies in its body with z along the axis of the joint. With R0, p0 the
   placement in the parent, w, e, a the angular velocity, angular acceleration and acceleration of
   the origin, all in the frame of the body:

     revolute:  R = R0 Rz(q), p = p0;         prismatic:  R = R0, p = p0 + R0 z q
     w = R' w_parent (+ z qd)
     e = R' e_parent (+ z qdd + (R' w_parent) x z qd)
     a = R' (a_parent + e_parent x p + w_parent x (w_parent x p)) (+ z qdd + 2 w x z qd)

   Force and moment about the origin, with mass m, first moment h and inertia I about the origin:

     f = m a + e x h + w x (w x h)            n = h x a + I e + w x I w
     f_parent += R f                          n_parent += R n + p x R f

   The torque of the joint is the z component of n (revolute), its force that of f (prismatic). */

#include <math.h>

#include "kernels.h"

typedef struct { lanes x, y, z; } vec;

INLINE vec add(vec a, vec b) { return (vec){a.x + b.x, a.y + b.y, a.z + b.z}; }

INLINE vec cross(vec a, vec b) {
    return (vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

INLINE vec cross_of(vec a, const double *b) {
    return (vec){a.y * b[2] - a.z * b[1], a.z * b[0] - a.x * b[2], a.x * b[1] - a.y * b[0]};
}

/* m v with a matrix by rows, and its transpose. */
INLINE vec turned(const double *m, vec v) {
    return (vec){
        m[0] * v.x + m[1] * v.y + m[2] * v.z,
        m[3] * v.x + m[4] * v.y + m[5] * v.z,
        m[6] * v.x + m[7] * v.y + m[8] * v.z,
    };
}

INLINE vec turned_back(const double *m, vec v) {
    return (vec){
        m[0] * v.x + m[3] * v.y + m[6] * v.z,
        m[1] * v.x + m[4] * v.y + m[7] * v.z,
        m[2] * v.x + m[5] * v.y + m[8] * v.z,
    };
}

/* Rz(q)' v and Rz(q) v. */
INLINE vec spun_back(lanes c, lanes s, vec v) {
    return (vec){c * v.x + s * v.y, c * v.y - s * v.x, v.z};
}

INLINE vec spun(lanes c, lanes s, vec v) {
    return (vec){c * v.x - s * v.y, s * v.x + c * v.y, v.z};
}

/* Sine and cosine: reduction by pi/2 in three parts, then the polynomials of Taylor's kind that
   the C libraries use on [-pi/4, pi/4]; below 2 units in the last place up to |x| = 1e6. */
INLINE void sine_cosine(lanes x, lanes *sine, lanes *cosine) {
    const double magic = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to an integer */
    lanes shifted = x * 0.63661977236758134308 + magic;
    whole quadrant = (whole)shifted;
    lanes k = shifted - magic;
    lanes r = x - k * 1.57079632673412561417e+00;
    r = r - k * 6.07710050630396597660e-11;
    r = r - k * 2.02226624879595063154e-21;
    lanes z = r * r;
    lanes s = z * 1.58969099521155010221e-10 - 2.50507602534068634195e-08;
    s = z * s + 2.75573137070700676789e-06;
    s = z * s - 1.98412698298579493134e-04;
    s = z * s + 8.33333333332248946124e-03;
    s = z * s - 1.66666666666666324348e-01;
    s = r + r * (z * s);
    lanes c = z * -1.13596475577881948265e-11 + 2.08757232129817482790e-09;
    c = z * c - 2.75573143513906633035e-07;
    c = z * c + 2.48015872894767294178e-05;
    c = z * c - 1.38888888888741095749e-03;
    c = z * c + 4.16666666666666019037e-02;
    lanes half = 0.5 * z, one = 1.0 - half;
    c = one + (((1.0 - one) - half) + z * (z * c));
    whole odd = -(quadrant & 1);
    whole first = (quadrant & 2) << 62; /* the bit of the sign */
    whole second = ((quadrant + 1) & 2) << 62;
    whole sine_bits = ((whole)s & ~odd) | ((whole)c & odd);
    whole cosine_bits = ((whole)c & ~odd) | ((whole)s & odd);
    *sine = (lanes)(sine_bits ^ first);
    *cosine = (lanes)(cosine_bits ^ second);
}

/* Where the reduction is not exact enough, and where x is not finite, the C library decides. */
INLINE void mend(lanes x, lanes *sine, lanes *cosine) {
    const lanes limit = (lanes){0} + 1e6;
    whole beyond = negative((whole)limit - ((whole)x & INT64_MAX)); /* bits rise with the amount */
    int64_t any = 0;
    for (int lane = 0; lane < LANES; lane++) any |= beyond[lane];
    for (int lane = 0; lane < LANES && any; lane++)
        if (beyond[lane]) {
            (*sine)[lane] = sin(x[lane]);
            (*cosine)[lane] = cos(x[lane]);
        }
}

typedef struct { vec w, e, a; } motion;

CLONES void inverse_dynamics_lanes(const chain *tree, const double *q, const double *v,
                                   const double *acc, double *tau) {
    motion state[MAX_JOINTS + 1];
    vec force[MAX_JOINTS + 1], moment[MAX_JOINTS + 1];
    lanes sines[MAX_JOINTS], cosines[MAX_JOINTS], slides[MAX_JOINTS];
    const lanes zero = {0};
    const vec none = {zero, zero, zero};
    state[0] = (motion){none, none, {zero - tree->gravity[0], zero - tree->gravity[1],
                                     zero - tree->gravity[2]}};
    for (int i = 0; i < tree->joints; i++) {
        const body *b = &tree->bodies[i];
        const motion *up = &state[b->parent];
        motion *own = &state[i + 1];
        lanes position = *(const lanes *)(q + LANES * i);
        lanes velocity = *(const lanes *)(v + LANES * i);
        lanes acceleration = *(const lanes *)(acc + LANES * i);
        vec w, e, a;
        if (b->prismatic) {
            vec p = {b->place[0] + b->turn[2] * position, b->place[1] + b->turn[5] * position,
                     b->place[2] + b->turn[8] * position};
            a = add(up->a, add(cross(up->e, p), cross(up->w, cross(up->w, p))));
            w = turned_back(b->turn, up->w);
            e = turned_back(b->turn, up->e);
            a = turned_back(b->turn, a);
            a.x += 2.0 * (w.y * velocity);
            a.y -= 2.0 * (w.x * velocity);
            a.z += acceleration;
            slides[i] = position;
        } else {
            lanes s, c;
            sine_cosine(position, &s, &c);
            mend(position, &s, &c);
            a = add(up->a, add(cross_of(up->e, b->place),
                               cross(up->w, cross_of(up->w, b->place))));
            w = spun_back(c, s, turned_back(b->turn, up->w));
            e = spun_back(c, s, turned_back(b->turn, up->e));
            a = spun_back(c, s, turned_back(b->turn, a));
            e.x += w.y * velocity;
            e.y -= w.x * velocity;
            e.z += acceleration;
            w.z += velocity;
            sines[i] = s;
            cosines[i] = c;
        }
        *own = (motion){w, e, a};
        const double *h = b->first_moment, *inertia = b->inertia;
        vec turning = cross(w, cross_of(w, h));
        vec f = cross_of(e, h);
        f = (vec){b->mass * a.x + f.x + turning.x, b->mass * a.y + f.y + turning.y,
                  b->mass * a.z + f.z + turning.z};
        vec lifted = cross_of(a, h);
        vec n = add(turned(inertia, e), cross(w, turned(inertia, w)));
        force[i + 1] = f;
        moment[i + 1] = (vec){n.x - lifted.x, n.y - lifted.y, n.z - lifted.z};
    }
    force[0] = moment[0] = none;
    for (int i = tree->joints - 1; i >= 0; i--) {
        const body *b = &tree->bodies[i];
        vec f = force[i + 1], n = moment[i + 1];
        *(lanes *)(tau + LANES * i) = b->prismatic ? f.z : n.z;
        vec p = {zero + b->place[0], zero + b->place[1], zero + b->place[2]};
        if (b->prismatic) {
            p = (vec){p.x + b->turn[2] * slides[i], p.y + b->turn[5] * slides[i],
                      p.z + b->turn[8] * slides[i]};
        } else {
            f = spun(cosines[i], sines[i], f);
            n = spun(cosines[i], sines[i], n);
        }
        f = turned(b->turn, f);
        n = turned(b->turn, n);
        force[b->parent] = add(force[b->parent], f);
        moment[b->parent] = add(moment[b->parent], add(n, cross(p, f)));
    }
}
