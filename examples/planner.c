/* An AV in C: keeps its lane and a time gap of 1.5 s. It reads questions from standard input, a line each, and prints
   answers (docs/av-programs.md). cc -O2 -o planner planner.c -lm && cornerforge check-av "cmd: ./planner" */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static double number(const char *from, const char *name) { /* what stands behind the next "name": */
    const char *at = strstr(from, name);
    return at ? atof(at + strlen(name)) : 0.0;
}

int main(void) {
    static char line[1 << 16]; /* a vehicle takes about 300 bytes */
    double wanted = 0.0, lane_width = 0.0;
    while (fgets(line, sizeof line, stdin)) {
        if (strstr(line, "\"type\":\"hello\"")) {
            puts("{\"type\":\"hello\",\"answers\":\"curvature\",\"memory\":false}");
        } else if (strstr(line, "\"type\":\"setup\"")) {
            wanted = number(line, "\"set_speed\":"), lane_width = number(line, "\"lane_width\":");
            puts("{\"type\":\"ready\"}");
        } else if (strstr(line, "\"type\":\"scene\"")) {
            const char *own = strstr(line, "\"own\":"), *box = strstr(line, "\"others\":");
            double x = number(own, "\"x\":"), y = number(own, "\"y\":"), v = number(own, "\"vx\":"), a = 0.4 * (wanted - v);
            double length = number(own, "\"length\":"), centre = lane_width * (number(own, "\"lane\":") + 0.5);
            while ((box = strstr(box + 1, "{\"id\":"))) { /* brake for whoever is ahead in the way */
                double ahead = number(box, "\"x\":") - x, closing = v - number(box, "\"vx\":");
                double gap = fmax(ahead - 0.5 * (length + number(box, "\"length\":")), 0.5);
                double follow = 0.1 * fmax(gap - 2.0 - 1.5 * v, -20.0) - 0.6 * closing;
                if (ahead > 0.0 && fabs(number(box, "\"y\":") - y) < 2.5)
                    a = fmin(a, follow - pow(fmax(closing, 0.0), 2.0) / (2.0 * gap));
            }
            double curvature = 0.002 * (centre - y) - 0.1 * number(own, "\"heading\":");
            printf("{\"world\":%d,\"answer\":[%.17g,%.17g]}\n", (int)number(line, "\"world\":"), a, curvature);
        } /* "reset" wants no answer */
        fflush(stdout);
    }
    return 0;
}
