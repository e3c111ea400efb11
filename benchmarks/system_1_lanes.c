/* System No. 1 for many sets of parameters side by side: the step of system_1_floor.c, its innermost loop over the sets.
 *
 * Each thread takes groups of LANES sets; one vector register holds the same number of several sets. With 16
 * LANES they all stay in registers, and each step waits for the last; with 64 the processor always has work. Only the greatest
 * force and the last displacement of each set are kept.
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
        for (size_t l = 0; l < LANES; l++) {
            yield[l] = h / (c_o[first + l] + theta * h * k_o[first + l]);
            decay[l] = 1.0 - yield[l] * k_o[first + l];
            stiffness[l] = 1.0 / (setback + yield[l]);
            x[l] = z[l] = peak[l] = 0.0;
            v[l] = v_o;
        }
        for (size_t k = 0; k < steps; k++) {
            #pragma omp simd
            for (size_t l = 0; l < LANES; l++) {
                const double x_free = x[l] + h * v[l] + fall, z_free = decay[l] * z[l];
                const double closing = x_free - z_free;
                const double R = closing > 0.0 ? stiffness[l] * closing : 0.0;
                v[l] += gain - slowing * R;
                x[l] = x_free - setback * R;
                z[l] = z_free + yield[l] * R;
                peak[l] = R > peak[l] ? R : peak[l];
            }
        }
        for (size_t l = 0; l < LANES; l++) {
            out[first + l][0] = peak[l];
            out[first + l][1] = x[l];
        }
    }
}
