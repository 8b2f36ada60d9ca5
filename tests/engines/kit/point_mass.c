/* An engine in C: a point mass that falls. It speaks the folder contract of docs/design/engine-process.md, and knows two operations,
   "kinematics" and "drive", of one free body. JSON is searched, not parsed: a toy. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static double mass, gravity[3], timestep, q0[7], v0[6];
static FILE *numbers, *answers;

static char *text_of(const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file) { fprintf(stderr, "no file %s\n", path); exit(2); }
    fseek(file, 0, SEEK_END);
    long size = ftell(file);
    char *text = calloc(size + 1, 1);
    rewind(file);
    if (fread(text, 1, size, file) != (size_t)size) exit(2);
    fclose(file);
    return text;
}

static void load(const char *folder) {
    char path[4096];
    snprintf(path, sizeof path, "%s/point.txt", folder);
    char *text = text_of(path), *at = text;
    double *all[] = {&mass, gravity, &timestep, q0, v0};
    int sizes[] = {1, 3, 1, 7, 6};
    for (int i = 0; i < 5; i++)
        for (int k = 0; k < sizes[i]; k++) all[i][k] = strtod(at, &at);
    free(text);
}

static void put(const double *values, int count) { fwrite(values, sizeof(double), count, numbers); }

static void form(const char *name, int rows, const char *rest, int last) {
    fprintf(answers, "\"%s\": {\"kind\": \"f8\", \"shape\": [%d%s], \"stored\": true}%s", name, rows, rest, last ? "" : ", ");
}

static void head(const char *op, int first) {
    fprintf(answers, "%s{\"op\": \"%s\", \"load_seconds\": 0, \"seconds\": 0, \"log\": [], \"result\": {}, \"arrays\": {",
            first ? "" : ", ", op);
}

/* q and v of every row as they were given: for one free body they are its pose and velocity */
static void kinematics(FILE *given, int rows, int first) {
    double *q = calloc(rows, 7 * sizeof *q), *v = calloc(rows, 6 * sizeof *v);
    if (fread(q, 7 * sizeof *q, rows, given) != (size_t)rows || fread(v, 6 * sizeof *v, rows, given) != (size_t)rows) exit(2);
    head("kinematics", first);
    form("pose", rows, ", 1, 7", 0), form("velocity", rows, ", 1, 6", 0), form("q", rows, ", 7", 0), form("v", rows, ", 6", 1);
    put(q, 7 * rows), put(v, 6 * rows), put(q, 7 * rows), put(v, 6 * rows);
    fprintf(answers, "}}");
    free(q), free(v);
}

static void drive(FILE *given, int steps, int every, int first) {
    int rows = 1 + (steps + every - 1) / every, row = 1;
    double q[7], v[6], effort[6], *pose = calloc(rows, sizeof q), *velocity = calloc(rows, sizeof v);
    double *time = calloc(rows, sizeof *time);
    if (fread(effort, sizeof effort, 1, given) != 1) exit(2);
    memcpy(q, q0, sizeof q), memcpy(v, v0, sizeof v), memcpy(pose, q, sizeof q), memcpy(velocity, v, sizeof v);
    for (int step = 1; step <= steps; step++) {
        for (int k = 0; k < 3; k++) {
            v[k] += timestep * (gravity[k] + effort[k] / mass); /* semi-implicit: the new velocity moves it */
            q[k] += timestep * v[k];
        }
        if (step % every == 0 || step == steps) {
            time[row] = step * timestep;
            memcpy(pose + 7 * row, q, sizeof q), memcpy(velocity + 6 * row, v, sizeof v), row++;
        }
    }
    head("drive", first);
    form("time", rows, "", 0), form("pose", rows, ", 1, 7", 0), form("velocity", rows, ", 1, 6", 1);
    put(time, rows), put(pose, 7 * rows), put(velocity, 6 * rows);
    fprintf(answers, "}}");
}

int main(void) {
    char *request = text_of("request.json"), *at = strstr(request, "\"operations\""), *next, folder[1024];
    FILE *given = fopen("request.bin", "rb");
    numbers = fopen("result.bin", "wb"), answers = fopen("result.json.part", "wb");
    fprintf(answers, "{\"schema\": 3, \"status\": \"ok\", \"engine\": \"point-mass\", \"engine_version\": \"1.0\", ");
    fprintf(answers, "\"numpy_version\": \"\", \"python_version\": \"\", \"platform\": \"C\", \"machine\": \"\", \"operations\": [");
    for (int index = 0; (at = strstr(at, "\"op\": \"")); index++) {
        next = strstr(at + 7, "\"op\": \"");
        sscanf(strstr(at, "\"artifacts\": \""), "\"artifacts\": \"%1023[^\"]", folder);
        load(folder);
        if (!strncmp(at + 7, "kinematics", 10)) kinematics(given, atoi(strstr(at, "\"shape\": [") + 10), index == 0);
        else if (!strncmp(at + 7, "drive", 5)) {
            char *phases = strstr(at, "\"phases\": [[") + 12;
            drive(given, atoi(phases), atoi(strchr(phases, ',') + 1), index == 0);
        } else { fprintf(stderr, "I do not know this operation\n"); return 3; }
        at = next ? next : at + 7;
    }
    fprintf(answers, "]}");
    fclose(numbers), fclose(answers);
    return rename("result.json.part", "result.json") != 0;
}
