/* What the library costs: ./figures FOLDER, a folder that the example `record` made of a scene with 12 parts.
 * Prints a name and a number a line. Run by `cargo xtask capi`. */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tactile_filter.h"

#define N_LOADS 9
#define N_TOUCHES 200

static void check(tf_status status)
{
    if (status != TF_STATUS_OK) {
        fprintf(stderr, "error %d: %s\n", (int)status, tf_last_error());
        exit(1);
    }
}

static double now_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e6 * (double)now.tv_sec + 1e-3 * (double)now.tv_nsec;
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int n)
{
    qsort(values, (size_t)n, sizeof *values, by_size);
    return values[n / 2];
}

/* A line of /proc/self/status, MiB. */
static double memory_mib(const char *key)
{
    char line[256];
    double kib = 0.0;
    FILE *status = fopen("/proc/self/status", "r");
    while (status != NULL && fgets(line, sizeof line, status) != NULL) {
        if (strncmp(line, key, strlen(key)) == 0) {
            kib = atof(line + strlen(key));
        }
    }
    if (status != NULL) {
        fclose(status);
    }
    return kib / 1024.0;
}

static unsigned char *read_frame(const char *folder, const char *name, tf_frame *frame)
{
    char path[4096];
    int width = 0, height = 0;
    unsigned char *pixels;
    FILE *file;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    file = fopen(path, "rb");
    if (file == NULL || fscanf(file, "P6 %d %d 255", &width, &height) != 2 || fgetc(file) != '\n' || width < 1
        || height < 1 || width > 10000 || height > 10000) {
        fprintf(stderr, "error: %s: expected a PPM file\n", path);
        exit(1);
    }
    frame->width_px = (size_t)width;
    frame->height_px = (size_t)height;
    frame->stride_bytes = 3 * frame->width_px;
    frame->format = TF_FORMAT_RGB8;
    pixels = malloc(frame->stride_bytes * frame->height_px);
    if (pixels == NULL || fread(pixels, frame->stride_bytes, frame->height_px, file) != frame->height_px) {
        fprintf(stderr, "error: %s: too short\n", path);
        exit(1);
    }
    fclose(file);
    frame->pixels = pixels;
    return pixels;
}

int main(int argc, char **argv)
{
    static double loads[N_LOADS], load_cpu[N_LOADS], submits[N_TOUCHES], polls[N_TOUCHES], answers[N_TOUCHES];
    char model_path[4096], bank_path[4096];
    tf_model *model = NULL;
    tf_bank *bank = NULL;
    tf_sensor *sensor = NULL;
    tf_runner *runner = NULL;
    tf_config *config = NULL;
    tf_frame rest, frame;
    tf_pose reach[81];
    size_t n_parts = 0;
    unsigned char *rest_pixels, *pixels;
    int i;

    if (argc != 2) {
        fprintf(stderr, "usage: figures FOLDER\n");
        return 2;
    }
    snprintf(model_path, sizeof model_path, "%s/model.safetensors", argv[1]);
    snprintf(bank_path, sizeof bank_path, "%s/parts.bank", argv[1]);
    for (i = 0; i < N_LOADS; i++) {
        const double start = now_us();
        const clock_t used = clock();
        tf_bank_free(bank);
        tf_model_free(model);
        check(tf_model_load(model_path, &model));
        check(tf_bank_load(model, bank_path, &bank));
        loads[i] = (now_us() - start) / 1e3;
        load_cpu[i] = 1e3 * (double)(clock() - used) / CLOCKS_PER_SEC;
        if (i == 0) {
            printf("first_load_ms %.1f\nresident_after_load_mib %.1f\n", loads[0], memory_mib("VmRSS:"));
        }
    }
    check(tf_bank_n_parts(bank, &n_parts));
    printf("n_parts %zu\nload_ms %.1f\n", n_parts, median(loads, N_LOADS));
    printf("load_cpu_ms %.1f\n", median(load_cpu, N_LOADS));

    rest_pixels = read_frame(argv[1], "rest.ppm", &rest);
    pixels = read_frame(argv[1], "touch-1.ppm", &frame);
    check(tf_sensor_new(model, &rest, &sensor));
    check(tf_config_new(model, TF_SIDE_HOLE, &config));
    for (i = 0; i < 81; i++) {
        const tf_pose motion = {2.0 * (i % 9 - 4), 2.0 * (i / 9 - 4), 0.0};
        reach[i] = motion;
    }
    check(tf_runner_start(sensor, bank, config, 2, &runner));
    tf_config_free(config);
    for (i = 0; i < N_TOUCHES; i++) {
        const struct timespec pause = {0, 200000};
        const tf_pose still = {0.0, 0.0, 0.0};
        tf_outcome outcome;
        double start = now_us(), called;
        const double submitted = start;
        check(tf_runner_submit_touch(runner, &frame, still, reach, 81, NULL));
        submits[i] = now_us() - start;
        do {
            nanosleep(&pause, NULL);
            called = now_us();
            check(tf_runner_poll(runner, &outcome));
            polls[i] = now_us() - called;
        } while (outcome.kind == TF_OUTCOME_KIND_NONE);
        answers[i] = (now_us() - submitted) / 1e3;
        check(outcome.status);
        check(tf_runner_submit_new_episode(runner, NULL, NULL));
        do {
            nanosleep(&pause, NULL);
            check(tf_runner_poll(runner, &outcome));
        } while (outcome.kind == TF_OUTCOME_KIND_NONE);
    }
    printf("submit_us %.1f\n", median(submits, N_TOUCHES));
    printf("submit_p99_us %.1f\n", submits[N_TOUCHES * 99 / 100]);
    printf("poll_us %.1f\n", median(polls, N_TOUCHES));
    printf("poll_p99_us %.1f\n", polls[N_TOUCHES * 99 / 100]);
    printf("touch_to_decision_ms %.1f\n", median(answers, N_TOUCHES));
    printf("resident_mib %.1f\n", memory_mib("VmRSS:"));
    printf("peak_resident_mib %.1f\n", memory_mib("VmHWM:"));
    tf_runner_free(runner);
    tf_sensor_free(sensor);
    tf_bank_free(bank);
    tf_model_free(model);
    free(pixels);
    free(rest_pixels);
    return 0;
}
