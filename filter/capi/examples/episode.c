/* One whole episode with a robot whose touches were recorded: ./episode FOLDER
 * The folder is made by: cargo run --release --package tactile-capi --example record -- FOLDER */
#include <stdio.h>
#include <stdlib.h>

#include "tactile_filter.h"

/* A mistake that cannot be repaired ends this program; a robot's would stop the arm. */
static void check(tf_status status)
{
    if (status != TF_STATUS_OK) {
        fprintf(stderr, "error %d: %s\n", (int)status, tf_last_error());
        exit(1);
    }
}

static void *allocate(size_t bytes)
{
    void *memory = malloc(bytes > 0 ? bytes : 1);
    if (memory == NULL) {
        fprintf(stderr, "error: no memory\n");
        exit(1);
    }
    return memory;
}

static const char *in_folder(const char *folder, const char *file)
{
    static char path[4096];
    int length = snprintf(path, sizeof path, "%s/%s", folder, file);
    if (length < 0 || (size_t)length >= sizeof path) {
        fprintf(stderr, "error: the folder's path is too long\n");
        exit(1);
    }
    return path;
}

/* Reads a PPM file; the pixels are to be freed. Yours asks the camera. */
static tf_frame read_frame(const char *path, unsigned char **pixels)
{
    tf_frame frame = {NULL, 0, 0, 0, TF_FORMAT_RGB8};
    int width = 0, height = 0;
    FILE *file = fopen(path, "rb");
    if (file == NULL || fscanf(file, "P6 %d %d 255", &width, &height) != 2 || fgetc(file) != '\n' || width < 1
        || height < 1 || width > 10000 || height > 10000) {
        fprintf(stderr, "error: %s: expected a PPM file\n", path);
        exit(1);
    }
    frame.width_px = (size_t)width;
    frame.height_px = (size_t)height;
    frame.stride_bytes = 3 * frame.width_px;
    *pixels = allocate(frame.stride_bytes * frame.height_px);
    if (fread(*pixels, frame.stride_bytes, frame.height_px, file) != frame.height_px) {
        fprintf(stderr, "error: %s: the file is too short\n", path);
        exit(1);
    }
    fclose(file);
    frame.pixels = *pixels;
    return frame;
}

/* The robot: it moves, touches and takes a picture. This one plays what was recorded. */
static tf_observation *touch(const tf_sensor *sensor, const char *folder, int n)
{
    char name[32];
    unsigned char *pixels = NULL;
    tf_observation *observation = NULL;
    tf_frame frame;
    snprintf(name, sizeof name, "touch-%d.ppm", n);
    frame = read_frame(in_folder(folder, name), &pixels);
    check(tf_sensor_observe(sensor, &frame, &observation));
    free(pixels);
    return observation;
}

static void print_pose(const char *label, tf_pose pose)
{
    printf("%s %.17g %.17g %.17g\n", label, pose.x_mm, pose.y_mm, pose.theta_rad);
}

static void print_belief(const tf_bank *bank, const tf_episode *episode)
{
    size_t n_parts = 0, n_modes = 0, i;
    const char *name = NULL;
    double *posterior;
    tf_mode *modes;
    tf_runner_up other;
    check(tf_episode_runner_up(episode, &other));
    if (other.has_part) {
        printf("runner-up %s probability %.17g\n", other.part_name, other.probability);
    } else {
        printf("no runner-up\n");
    }
    check(tf_episode_class_posterior(episode, NULL, 0, &n_parts));
    posterior = allocate(n_parts * sizeof *posterior);
    check(tf_episode_class_posterior(episode, posterior, n_parts, &n_parts));
    for (i = 0; i < n_parts; i++) {
        check(tf_bank_part_name(bank, i, &name));
        printf("posterior %s %.17g\n", name, posterior[i]);
    }
    free(posterior);
    check(tf_episode_modes(episode, NULL, 0, &n_modes));
    modes = allocate(n_modes * sizeof *modes);
    check(tf_episode_modes(episode, modes, n_modes, &n_modes));
    for (i = 0; i < n_modes; i++) {
        check(tf_bank_part_name(bank, modes[i].part, &name));
        printf("mode %s %.17g", name, modes[i].mass);
        print_pose(" at", modes[i].part_from_sensor);
    }
    free(modes);
}

static void print_done(const tf_decision *done)
{
    static const char *const reasons[] = {"none", "confident", "none of these", "touch limit", "nothing to learn"};
    const tf_estimate *estimate = &done->estimate;
    int i;
    printf("stop: %s after %zu touches\n", reasons[done->stop], estimate->n_touches);
    printf("part %s probability %.17g\n", estimate->part_name, estimate->probability);
    print_pose("pose", estimate->part_from_sensor);
    print_pose("pose", estimate->part_from_first);
    printf("covariance");
    for (i = 0; i < 9; i++) {
        printf(" %.17g", estimate->covariance[i]);
    }
    printf("\nfit %.17g entropy %.17g\n", estimate->fit, estimate->entropy_nats);
}

/* Saves the episode and goes on with the saved one, as after a power cut. */
static tf_episode *save_and_restore(const tf_bank *bank, tf_episode *episode)
{
    size_t length = 0;
    unsigned char *json;
    tf_episode *restored = NULL;
    check(tf_episode_record(episode, NULL, 0, &length));
    json = allocate(length);
    check(tf_episode_record(episode, json, length, &length));
    tf_episode_free(episode);
    check(tf_episode_restore(bank, json, length, &restored));
    free(json);
    return restored;
}

int main(int argc, char **argv)
{
    tf_model *model = NULL;
    tf_bank *bank = NULL;
    tf_sensor *sensor = NULL;
    tf_observation *observation = NULL;
    tf_episode *episode = NULL;
    tf_config *config = NULL;
    tf_decision decision;
    tf_pose reach[81];
    tf_frame at_rest;
    unsigned char *pixels = NULL;
    int i, n;

    if (argc != 2 || tf_abi_version() != TF_ABI_VERSION) {
        fprintf(stderr, "usage: episode FOLDER, with a library of version %d\n", (int)TF_ABI_VERSION);
        return 2;
    }
    check(tf_model_load(in_folder(argv[1], "model.safetensors"), &model));
    check(tf_bank_load(model, in_folder(argv[1], "parts.bank"), &bank));
    at_rest = read_frame(in_folder(argv[1], "rest.ppm"), &pixels);
    check(tf_sensor_new(model, &at_rest, &sensor));
    free(pixels);
    check(tf_config_new(model, TF_SIDE_HOLE, &config));
    check(tf_config_set_number(config, "stop_place_mm", 0.3));
    check(tf_config_set(config, "n_finalists", "none"));
    for (i = 0; i < 81; i++) { /* motions of up to 8 mm along x and y */
        tf_pose motion = {2.0 * (i % 9 - 4), 2.0 * (i / 9 - 4), 0.0};
        reach[i] = motion;
    }

    observation = touch(sensor, argv[1], 1);
    check(tf_episode_begin(config, bank, observation, &episode));
    tf_observation_free(observation);
    tf_config_free(config);
    for (n = 2;; n++) {
        check(tf_episode_decide(episode, reach, 81, &decision));
        if (decision.kind == TF_DECISION_KIND_DONE) {
            break;
        }
        printf("touch %d after a motion of", n);
        print_pose("", decision.sensor_from_next);
        observation = touch(sensor, argv[1], n);
        /* Give the motion that was really made; the one recorded here is exact. */
        check(tf_episode_observe(episode, decision.sensor_from_next, observation));
        tf_observation_free(observation);
        episode = save_and_restore(bank, episode);
    }
    print_done(&decision);
    print_belief(bank, episode);

    tf_episode_free(episode);
    tf_sensor_free(sensor);
    tf_bank_free(bank);
    tf_model_free(model);
    return 0;
}
