/* System No. 1 for many sets of parameters side by side: the step of system_1_floor.c, its innermost loop over the sets.
 *
 * Each thread takes groups of LANES sets; one vector register holds the same number of several sets. With 16
 * LANES they all stay in registers, and each step waits for the last; with 64 the processor always has work. Only the greatest
 * force and the last displacement of each set are kept.
 *
 * With SAME defined the step has the operations of a sweep, which has the bits of a single run: 10 products, where 6 do, and a
 * quotient by W. Its yardstick is compiled without fused multiply-add, -ffp-contract=off.
 */
#include <stddef.h>

#ifndef LANES
#define LANES 16
#endif

/* Fill out[i] = (max R, x at the end) of the sets i < sets, a multiple of LANES, with the stiffness k_o[i] and damping c_o[i]. */
void system_1_lanes(size_t sets, size_t steps, double h, double theta, double m, const double *restrict k_o,
                    const double *restrict c_o, double g, double v_o, double (*restrict out)[2])
{
    const double slowing = h / m, setback = theta * h * slowing, gain = h * g, fall = theta * h * gain;

    #pragma omp parallel for schedule(static)
    for (size_t first = 0; first < sets; first += LANES) {
        double x[LANES], v[LANES], z[LANES], peak[LANES], yield[LANES], decay[LANES], stiffness[LANES];
#ifdef SAME
        const double scale = 2.0 / h, by_x = -scale, by_v = -scale * h, offset = -scale * fall, rate = 1.0 / h;
        const double setback_P = setback * rate, slowing_P = slowing * rate, keeping = 2.0 * theta; /* 1 where theta is 1/2 */
        double W[LANES], by_z[LANES], yield_P[LANES];
#endif
        for (size_t l = 0; l < LANES; l++) {
            yield[l] = h / (c_o[first + l] + theta * h * k_o[first + l]);
            decay[l] = 1.0 - yield[l] * k_o[first + l];
            stiffness[l] = 1.0 / (setback + yield[l]);
#ifdef SAME
            W[l] = scale * rate * (setback + yield[l]);
            by_z[l] = scale * decay[l];
            yield_P[l] = rate * yield[l];
#endif
            x[l] = z[l] = peak[l] = 0.0;
            v[l] = v_o;
        }
        for (size_t k = 0; k < steps; k++) {
            #pragma omp simd
            for (size_t l = 0; l < LANES; l++) {
#ifdef SAME
                const double q = offset + by_x * x[l] + by_z[l] * z[l] + by_v * v[l];
                const double P = q < 0.0 ? -q / W[l] : 0.0;
                x[l] = fall + x[l] + h * v[l] - setback_P * P;
                z[l] = decay[l] * z[l] + yield_P[l] * P;
                v[l] = gain + keeping * v[l] - slowing_P * P;
                const double R = rate * P;
#else
                const double x_free = x[l] + h * v[l] + fall, z_free = decay[l] * z[l];
                const double closing = x_free - z_free;
                const double R = closing > 0.0 ? stiffness[l] * closing : 0.0;
                v[l] += gain - slowing * R;
                x[l] = x_free - setback * R;
                z[l] = z_free + yield[l] * R;
#endif
                peak[l] = R > peak[l] ? R : peak[l];
            }
        }
        for (size_t l = 0; l < LANES; l++) {
            out[first + l][0] = peak[l];
            out[first + l][1] = x[l];
        }
    }
}
