/* The profile of an excitation that varies in time, as tcc_sim.model.profile.profile_of computes it. */

/* A line of a profile: n points, times and values from these references on, values some places apart; without points
   constant. A harmonic with varying amplitude has its number, and a reference of its phase, below 0 for none. */
typedef struct { int times, values, apart, n, number, phase; } tcc_line;

/* Columns of a profile before those of the harmonics, and columns of a harmonic. */
enum { TCC_SWELLS = 11, TCC_SWELL = 4 };

/* Fill rows of `columns` numbers from `time` on, where the phase is `phase`, and return their number. The lines are those
   of frequency, mean torque, mean pressure and harmonics. */
static int tcc_profile(const double *x, const tcc_line *lines, int count, double time, double phase, double *at,
                       int columns)
{
    int rows = 1;
    double turned = 0.0;
    at[0] = time;
    for (int j = 0; j < count; j++)
        for (int i = 0; i < lines[j].n; i++) {
            double t = x[lines[j].times + i];
            int k = rows;
            while (k > 0 && at[(k - 1) * columns] > t) k--;
            if (k == 0 || at[(k - 1) * columns] == t) continue;
            for (int m = rows++; m > k; m--) at[m * columns] = at[(m - 1) * columns];
            at[k * columns] = t;
        }
    for (int k = 0; k < rows; k++)
        for (int j = 1; j < TCC_SWELLS; j++) at[k * columns + j] = 0.0;
    for (int j = 0; j < count; j++) {
        const tcc_line *line = lines + j;
        const double *times = x + line->times, *values = x + line->values;
        int column = j < 3 ? 2 + 2 * j : TCC_SWELLS + (j - 3) * TCC_SWELL + 2, harmonic = line->number == 1, i = 0;
        for (int k = 0; k < line->n; k++)
            if (values[k * line->apart] != 0.0) harmonic = line->number;
        for (int k = 0; k < rows; k++) {
            double *row = at + k * columns, rate = 0.0;
            while (i < line->n - 1 && times[i + 1] <= row[0]) i++;
            if (i < line->n - 1)
                rate = (values[(i + 1) * line->apart] - values[i * line->apart]) / (times[i + 1] - times[i]);
            row[column] = line->n ? values[i * line->apart] + rate * (row[0] - times[i]) : values[0];
            row[column + 1] = rate;
            if (j < 3) continue;
            row[column - 2] = harmonic;
            row[column - 1] = line->phase < 0 ? 0.0 : x[line->phase];
        }
    }
    for (int k = 0; k < rows; k++) {
        double *row = at + k * columns, step = k ? row[0] - row[-columns] : 0.0;
        if (k) turned = turned + step * (row[2 - columns] + 0.5 * row[3 - columns] * step);
        row[1] = turned + phase;
    }
    return rows;
}
