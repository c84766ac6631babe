/* One step of N robots with the paper's model, in the same arithmetic as CMR's own step: the reference. */
#define ROUND 6755399441055744.0 /* adding and subtracting it rounds to integers */
#define GAUSS 0.28867513459481287

void step(long n, double *restrict x, double *restrict y, double *restrict theta, double *restrict psi_left,
          double *restrict psi_right, const double *restrict left, const double *restrict right,
          const double *restrict c0, const double *restrict c1, const double *restrict c2, const double *restrict c3,
          const double *restrict c4, const double *restrict c5, const double *restrict c6, const double *restrict c7,
          const double *restrict c8)
{
    for (long i = 0; i < n; i++) {
        double final_left = left[i] * c0[i], final_right = right[i] * c0[i];
        double off_left = psi_left[i] - final_left, off_right = psi_right[i] - final_right;
        double final_turn = final_right - final_left, off_turn = off_right - off_left, off_sum = off_left + off_right;
        double speed = c2[i] * (final_left + final_right) + c3[i] * off_sum, change = c4[i] * off_sum;
        double steady = c5[i] * final_turn;
        double middle = theta[i] + (0.5 * steady + c7[i] * off_turn), half = GAUSS * steady + c8[i] * off_turn;

        double turns = (middle * 0.3183098861837907 + ROUND) - ROUND;
        double r = ((middle - turns * 3.141592651605606) - turns * 1.9841871583270443e-09)
                   - turns * 1.034036596358821e-18;
        double odd = turns - 2.0 * ((turns * 0.5 + ROUND) - ROUND), sign = 1.0 - 2.0 * odd * odd, z = r * r;
        double sine = r + r * (z * (-0.16666666666666072 + z * (0.008333333333282756 + z * (-0.00019841269824861897
                      + z * (2.7557316609073673e-06 + z * (-2.505188194671259e-08 + z * (1.6048168318165643e-10
                      + z * -7.374387503862757e-13)))))));
        double cosine = 1.0 + z * (-0.4999999999999997 + z * (0.04166666666666388 + z * (-0.001388888888877299
                        + z * (2.4801587277414926e-05 + z * (-2.755731639102575e-07 + z * (2.0876561839933163e-09
                        + z * (-1.1462901901757276e-11 + z * 4.608977003001797e-14)))))));
        double e = half * half;
        double half_sine = half * (1.0 + e * (-1 / 6. + e * (1 / 120. + e * (-1 / 5040. + e * (1 / 362880.)))));
        double half_cosine = 1.0 + e * (-0.5 + e * (1 / 24. + e * (-1 / 720. + e * (1 / 40320.))));

        double along = sign * (speed * half_cosine), across = sign * (change * half_sine);
        x[i] += along * cosine - across * sine;
        y[i] += along * sine + across * cosine;
        theta[i] += steady + c6[i] * off_turn;
        psi_left[i] += off_left * c1[i];
        psi_right[i] += off_right * c1[i];
    }
}
