/* System No. 1 by the θ-method, and nothing else: the least that a step can cost.
 *
 *     m x'' = m g - R,    c_o z' + k_o z = R,    0 <= u = z - x  ⟂  R >= 0                       (2a, b, c)
 *
 * The mean velocities of a step, w_x = (x⁺ - x)/h and w_z = (z⁺ - z)/h, balance the forces at t + θ h:
 *
 *     w_x = v + θ h (g - R/m),    w_z = (R - k_o z)/(c_o + θ h k_o),    v⁺ = v + h (g - R/m).
 *
 * With R = 0 they predict x* and z*. The gap is closed at the end of the step, u⁺ = z⁺ - x⁺, which is an LCP of one row,
 *
 *     0 <= R  ⟂  z* - x* + h W R >= 0,    W = θ h/m + 1/(c_o + θ h k_o),    so    R = [x* - z*]⁺ / (h W),
 *
 *     v⁺ = v + h g - (h/m) R,    x⁺ = x* - θ (h²/m) R,    z⁺ = z* + h/(c_o + θ h k_o) R.
 */
#include <stddef.h>

/* Fill out[k] = (x, v, z at the end of step k, R of step k) for 0 <= k < steps, from x = z = 0 and v = v_o. */
void system_1(size_t steps, double h, double theta, double m, double k_o, double c_o, double g, double v_o,
              double (*restrict out)[4])
{
    const double yield = h / (c_o + theta * h * k_o);
    const double decay = 1.0 - yield * k_o;
    const double slowing = h / m, setback = theta * h * slowing;
    const double stiffness = 1.0 / (setback + yield);
    const double gain = h * g, fall = theta * h * gain;
    double x = 0.0, v = v_o, z = 0.0;

    for (size_t k = 0; k < steps; k++) {
        const double x_free = x + h * v + fall, z_free = decay * z;
        const double closing = x_free - z_free;
        const double R = closing > 0.0 ? stiffness * closing : 0.0;
        v += gain - slowing * R;
        x = x_free - setback * R;
        z = z_free + yield * R;
        out[k][0] = x;
        out[k][1] = v;
        out[k][2] = z;
        out[k][3] = R;
    }
}
