/* The filter as a C library: which peg fits this hole, and where the hole is, found by touch. C99 and later, C++ too.
 *
 * Pointers. Each points to what its type says. Null is refused with TF_STATUS_NULL_POINTER unless a function allows it.
 * A handle lives from the call that gives it until its ..._free(); to use it later is an error that cannot be detected.
 * Handles do not depend on one another: they may be freed in any order. Texts and values that a function gives belong to
 * whom its comment says. Buffers: (buffer, capacity, required) writes all or nothing, and always the required length;
 * with a capacity of 0 (the buffer may be null) it is a question for that length.
 *
 * Errors. After any status but TF_STATUS_OK nothing was changed, and tf_last_error() says in words what was expected and
 * what came. No panic crosses this border.
 *
 * Threads. The library starts none but that of tf_runner. Each handle's comment says who may use it at once. To free a
 * handle while another thread uses it is an error that cannot be detected.
 *
 * Made by cbindgen from filter/capi/src: change that, then run TACTILE_WRITE_HEADER=1 cargo test -p tactile-capi. */


#ifndef TACTILE_FILTER_H
#define TACTILE_FILTER_H

#include <stddef.h>
#include <stdint.h>

/**
 * Version of this interface: changed whenever a program must be compiled again. Compare it with tf_abi_version().
 */
#define TF_ABI_VERSION 1

/**
 * tf_estimate.symmetry_order of a round part, which feels the same after any turn.
 */
#define TF_ROUND 360

/**
 * Bit of tf_estimate.warnings: no edged touch looks like any recorded view; perhaps none of these parts.
 */
#define TF_WARNING_LOW_SIMILARITY 1

/**
 * Bit of tf_estimate.warnings: every touch was blank, no edge was ever seen.
 */
#define TF_WARNING_NOTHING_SEEN 2

/**
 * Bit of tf_estimate.warnings: the bank, or the fit of its maps, is for the other side than the one that is touched.
 */
#define TF_WARNING_OTHER_SIDE 4

/**
 * Bit of tf_estimate.warnings: what was felt is longer or shorter than the named part, which is not named with confidence.
 */
#define TF_WARNING_OTHER_SIZE 8

/**
 * What every function answers. After any of them but TF_STATUS_OK nothing was changed, unless it says so.
 */
typedef enum tf_status {
    /**
     * Done.
     */
    TF_STATUS_OK = 0,
    /**
     * A pointer that must not be null is null, or is not aligned for what it points to.
     */
    TF_STATUS_NULL_POINTER = 1,
    /**
     * A size, length, index or text that makes no sense; tf_last_error() says which.
     */
    TF_STATUS_ARGUMENT = 2,
    /**
     * The buffer is shorter than what there is to write; the required length was written, nothing else.
     */
    TF_STATUS_BUFFER_TOO_SMALL = 3,
    /**
     * Another thread is using this handle in a way that excludes this call; try again later.
     */
    TF_STATUS_BUSY = 4,
    /**
     * This library is at fault. The process goes on; free the handle that was used.
     */
    TF_STATUS_PANIC = 5,
    /**
     * The lamps are off: the frame is dark.
     */
    TF_STATUS_FRAME_DARK = 10,
    /**
     * The camera is blinded or exposes too long.
     */
    TF_STATUS_FRAME_SATURATED = 11,
    /**
     * The frame is uniform: no picture of a sensor.
     */
    TF_STATUS_FRAME_UNIFORM = 12,
    /**
     * The frame has another size than the frame at rest.
     */
    TF_STATUS_FRAME_WRONG_SIZE = 13,
    /**
     * Something else is wrong with the frame.
     */
    TF_STATUS_FRAME_OTHER = 14,
    /**
     * The same picture, byte for byte, after a real motion: the camera has stopped.
     */
    TF_STATUS_FROZEN_FRAME = 15,
    /**
     * The motion is not finite, or no robot's.
     */
    TF_STATUS_MOTION = 16,
    /**
     * The observation, sensor or bank is of another model.
     */
    TF_STATUS_WRONG_MODEL = 17,
    /**
     * The saved episode is of another bank or version.
     */
    TF_STATUS_WRONG_BANK = 18,
    /**
     * No motion was offered that could be made.
     */
    TF_STATUS_EMPTY_REACH = 19,
    /**
     * Numbers that no sensor makes.
     */
    TF_STATUS_OBSERVATION = 20,
    /**
     * A setting outside its range.
     */
    TF_STATUS_CONFIG = 21,
    /**
     * A file that cannot be read.
     */
    TF_STATUS_FILE = 22,
    /**
     * A model, bank or frame at rest that cannot be used: the file is damaged or of another kind, the frame too small.
     */
    TF_STATUS_UNUSABLE = 23,
    /**
     * A touch of a peg in an episode of holes, or the other way.
     */
    TF_STATUS_WRONG_SIDE = 24,
    /**
     * The runner has as many jobs without a polled outcome as it may have.
     */
    TF_STATUS_QUEUE_FULL = 30,
    /**
     * The runner's thread has ended.
     */
    TF_STATUS_STOPPED = 31,
    /**
     * There is no touch to estimate from.
     */
    TF_STATUS_NO_EPISODE = 32,
    /**
     * An error that this version has no number for; tf_last_error() says what.
     */
    TF_STATUS_OTHER = 99,
} tf_status;

/**
 * What to do.
 */
typedef enum tf_decision_kind {
    /**
     * Move by sensor_from_next, touch, and take that touch in.
     */
    TF_DECISION_KIND_TOUCH = 0,
    /**
     * Stop.
     */
    TF_DECISION_KIND_DONE = 1,
} tf_decision_kind;

/**
 * Why an episode is over.
 */
typedef enum tf_stop {
    /**
     * It is not: go on.
     */
    TF_STOP_NONE = 0,
    /**
     * A part is more probable than stop_probability, explains the touches, and was told from the next likeliest.
     */
    TF_STOP_CONFIDENT = 1,
    /**
     * No part explains the touches: this one is not in the bank.
     */
    TF_STOP_NONE_OF_THESE = 2,
    /**
     * max_touches touches were made.
     */
    TF_STOP_TOUCH_LIMIT = 3,
    /**
     * No motion of the reach leads anywhere that was not touched.
     */
    TF_STOP_NOTHING_TO_LEARN = 4,
} tf_stop;

/**
 * What an outcome is of.
 */
typedef enum tf_outcome_kind {
    /**
     * Nothing: no job is done that was not polled yet.
     */
    TF_OUTCOME_KIND_NONE = 0,
    /**
     * A touch, by tf_runner_submit_touch(): `decision` says what to do next.
     */
    TF_OUTCOME_KIND_DECISION = 1,
    /**
     * An estimate, by tf_runner_submit_estimate(): `decision.estimate` holds it.
     */
    TF_OUTCOME_KIND_ESTIMATE = 2,
    /**
     * A new episode, by tf_runner_submit_new_episode().
     */
    TF_OUTCOME_KIND_NEW_EPISODE = 3,
    /**
     * A frame at rest, by tf_runner_submit_rest().
     */
    TF_OUTCOME_KIND_REST = 4,
    /**
     * A job that was not done: `status` says why, and tf_last_error() in words.
     */
    TF_OUTCOME_KIND_ERROR = 5,
} tf_outcome_kind;

/**
 * The order of the bytes of a pixel.
 */
typedef enum tf_format {
    /**
     * Red, green, blue, 8 bits each.
     */
    TF_FORMAT_RGB8 = 0,
    /**
     * Blue, green, red, 8 bits each: what OpenCV gives.
     */
    TF_FORMAT_BGR8 = 1,
} tf_format;

/**
 * Which half of a mating pair is touched.
 */
typedef enum tf_side {
    /**
     * A hole, whose peg is looked for.
     */
    TF_SIDE_HOLE = 0,
    /**
     * A raised part, recognised among the bank's own.
     */
    TF_SIDE_PEG = 1,
} tf_side;

/**
 * The recorded views of the parts. Never changes: any number of threads may use it at once.
 */
typedef struct tf_bank tf_bank;

/**
 * What an episode runs with: what was measured of a model, and these settings, each with what it may be:
 * - stop_probability: 0..=1
 * - stop_place_mm, in mm: a positive number, or none
 * - max_touches: 1 to 1000
 * - false_accept: 0..=1, or none
 * - false_refuse: 0..=1
 * - verify: a number, not negative
 * - travel_nats_per_mm, in nats/mm: a number, not negative
 * - n_draws: 1 to 100000
 * - n_suppositions: 1 to 10000
 * - n_finalists: at least 1, or none
 * - subdivisions: 1 to 4
 * - seed: any
 *
 * README.md says what each does. Several threads may read a config at once, but only one may use it while a setting is
 * changed: the others get TF_STATUS_BUSY. An episode and a runner copy the config that they begin with.
 */
typedef struct tf_config tf_config;

/**
 * One hole being identified. Several threads may ask at once, but only one may use it while a touch is taken in: the others
 * get TF_STATUS_BUSY.
 */
typedef struct tf_episode tf_episode;

/**
 * The lamps of a sensor that nobody calibrated, learnt from its touches of anything. One thread at a time: TF_STATUS_BUSY
 * where another one uses it.
 */
typedef struct tf_light tf_light;

/**
 * A trained network. Never changes: any number of threads may use it at once.
 */
typedef struct tf_model tf_model;

/**
 * What the filter takes in of one touch. Never changes: any number of threads may use it at once.
 */
typedef struct tf_observation tf_observation;

/**
 * An episode on a thread of its own, for callers that must never wait. tf_runner_submit_...() and tf_runner_poll() never
 * wait for the thread. Use it from one thread at a time: a call that meets another gets TF_STATUS_BUSY.
 */
typedef struct tf_runner tf_runner;

/**
 * The camera, the gel and its frame at rest, bound to a model. Never changes: any number of threads may use it at once.
 */
typedef struct tf_sensor tf_sensor;

/**
 * A rigid motion or a pose in the plane. x to the right, y downwards, angles from x towards y, as in the sensor's image.
 * Zeros are no motion.
 */
typedef struct tf_pose {
    /**
     * Along x, mm.
     */
    double x_mm;
    /**
     * Along y, mm.
     */
    double y_mm;
    /**
     * The turn, rad; any finite angle is taken, one above -pi and up to pi is given.
     */
    double theta_rad;
} tf_pose;

/**
 * What is known after the touches so far.
 */
typedef struct tf_estimate {
    /**
     * Index of the most probable part in the bank; the first of equals.
     */
    size_t part;
    /**
     * Its name, UTF-8. Belongs to the episode or runner that gave the estimate, and is valid until that is freed.
     */
    const char *part_name;
    /**
     * Its probability, 0 to 1.
     */
    double probability;
    /**
     * Pose of the sensor now, in the part's frame.
     */
    struct tf_pose part_from_sensor;
    /**
     * Pose of the sensor at its first touch, in the part's frame.
     */
    struct tf_pose part_from_first;
    /**
     * Covariance of that pose over (x mm, y mm, theta rad), row by row, over all that is believed of where the part is: other
     * places count as far as they are away.
     */
    double covariance[9];
    /**
     * 1 where `fit`, `none_probability` and `stranger_rate` hold numbers: an edge was felt.
     */
    uint32_t has_fit;
    /**
     * Bits TF_WARNING_...: reasons to doubt all this.
     */
    uint32_t warnings;
    /**
     * How well the part explains what was felt: how many standard deviations the edged touches look more like its views than the
     * touches of a part that is there do on average.
     */
    double fit;
    /**
     * Probability that it is none of the bank's parts, 0 to 1, where that was as likely as the named part before the first touch.
     */
    double none_probability;
    /**
     * How often a part that is not in the bank comes to so good a match at any touch of an episode, 0 to 1.
     */
    double stranger_rate;
    /**
     * Entropy over all states, nats.
     */
    double entropy_nats;
    /**
     * Log-probability of all touches, nats, up to a constant.
     */
    double log_evidence;
    /**
     * Touches taken in.
     */
    size_t n_touches;
    /**
     * Turns by 360 degrees / symmetry_order about the centre change nothing that can be felt; 1: only the full turn does
     * so; TF_ROUND: any turn.
     */
    size_t symmetry_order;
    /**
     * That centre along x and y in the part's frame, mm.
     */
    double symmetry_centre_mm[2];
} tf_estimate;

/**
 * A picture of the sensor. The library copies what it needs: the pixels are the caller's again after the call.
 */
typedef struct tf_frame {
    /**
     * The first byte of the top row; 3 bytes a pixel, rows from the top.
     */
    const uint8_t *pixels;
    /**
     * Width in pixels, 1 to 32768.
     */
    size_t width_px;
    /**
     * Height in pixels, 1 to 32768.
     */
    size_t height_px;
    /**
     * From the start of a row to the start of the next, bytes; at least 3 * width_px.
     */
    size_t stride_bytes;
    /**
     * A value of tf_format.
     */
    uint32_t format;
} tf_frame;

/**
 * How a sensor's lamps light a slope of the gel, as `tactile-data calibrate` writes it (`[light]`): for red, green and
 * blue the factors of 1, x, y, x^2, x y, y^2 over the frame, x and y in -1..1, x right and y down, counts.
 */
typedef struct tf_lamps {
    /**
     * Response to a slope along x.
     */
    float along_x[3][6];
    /**
     * Response to a slope along y.
     */
    float along_y[3][6];
} tf_lamps;

/**
 * What to do next.
 */
typedef struct tf_decision {
    /**
     * Touch again, or stop.
     */
    enum tf_decision_kind kind;
    /**
     * Why to stop; TF_STOP_NONE for a touch.
     */
    enum tf_stop stop;
    /**
     * For a touch: the motion to make, one of the reach, in the sensor's frame.
     */
    struct tf_pose sensor_from_next;
    /**
     * For a stop: what was found; else zeros and an empty name.
     */
    struct tf_estimate estimate;
} tf_decision;

/**
 * The second most probable part.
 */
typedef struct tf_runner_up {
    /**
     * 1 where there is one; 0 where no other part is left, then all else is zeros and an empty name.
     */
    uint32_t has_part;
    /**
     * Its index in the bank; the first of equals.
     */
    size_t part;
    /**
     * Its name, UTF-8. Belongs to the episode or runner, and is valid until that is freed.
     */
    const char *part_name;
    /**
     * Its probability, 0 to 1.
     */
    double probability;
} tf_runner_up;

/**
 * A pose of the sensor on a part, and its probability.
 */
typedef struct tf_state {
    /**
     * Pose of the sensor now, in the part's frame.
     */
    struct tf_pose part_from_sensor;
    /**
     * Its probability, 0 to 1; over all poses of all parts they sum to 1.
     */
    double probability;
} tf_state;

/**
 * A peak of the belief with the states that lead up to it.
 */
typedef struct tf_mode {
    /**
     * Index of the part in the bank.
     */
    size_t part;
    /**
     * Probability of the mode's states, 0 to 1; of its twins' too, where the part is symmetric.
     */
    double mass;
    /**
     * Mean pose of the sensor now, in the part's frame.
     */
    struct tf_pose part_from_sensor;
    /**
     * Covariance of that pose over (x mm, y mm, theta rad), row by row.
     */
    double covariance[9];
} tf_mode;

/**
 * A peg in the hand, above the hole that the filter named.
 */
typedef struct tf_held_peg {
    /**
     * By how much its hole is wider on every side, mm.
     */
    double play_mm;
    /**
     * From the origin of its part's frame to its farthest point, mm.
     */
    double radius_mm;
    /**
     * How well its pose in the hand is known: covariance over (x mm, y mm, theta rad) in the part's frame, row by row. After touches of
     * the peg itself it is their tf_episode_offset_covariance(); zeros: exactly.
     */
    double covariance[9];
    /**
     * Poses at most, at least 1.
     */
    uint32_t most_poses;
} tf_held_peg;

/**
 * What came of a job.
 */
typedef struct tf_outcome {
    /**
     * What it is of.
     */
    enum tf_outcome_kind kind;
    /**
     * TF_STATUS_OK, or why the job was not done.
     */
    enum tf_status status;
    /**
     * The number that the job was given when it was submitted.
     */
    uint64_t ticket;
    /**
     * What to do next, or what is known.
     */
    struct tf_decision decision;
} tf_outcome;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The message of the last call on this thread that did not answer TF_STATUS_OK, one line in English, UTF-8; "" before the
 * first. Belongs to the library, and is valid until the next call on this thread.
 */
const char *tf_last_error(void);

/**
 * The TF_ABI_VERSION that the library was built with. Where the header's differs, compile again.
 */
uint32_t tf_abi_version(void);

/**
 * a_from_c: one motion after another, each in the frame that the one before led to; the sum of the motions since a touch.
 */
struct tf_pose tf_pose_compose(struct tf_pose a_from_b,
                               struct tf_pose b_from_c);

/**
 * b_from_a: the motion back.
 */
struct tf_pose tf_pose_inverse(struct tf_pose a_from_b);

/**
 * The poses that touch cannot tell from an estimate's, itself first: insert at any of them.
 * \param required  where their number goes, symmetry_order, or 36 of a round part; with a capacity of 0
 *                  nothing else is written
 */
enum tf_status tf_estimate_twins(const struct tf_estimate *estimate,
                                 struct tf_pose *buffer,
                                 size_t capacity,
                                 size_t *required);

/**
 * Loads a model from its file (`maze-small.safetensors`).
 * \param path  the file's path, ending with a zero
 * \param out   where the handle goes, to be freed by tf_model_free(); null after an error
 * TF_STATUS_FILE: it cannot be read. TF_STATUS_UNUSABLE: it is damaged, or no model.
 */
enum tf_status tf_model_load(const char *path, struct tf_model **out);

/**
 * Loads a model, and networks that draw a map of each touch and judge by them (`maze-small.maps.safetensors`): with banks that have
 * maps of their parts (`tactile-infer bank --maps`), places are found and parts are verified by them.
 * \param maps  the path of the networks' file, ending with a zero
 * TF_STATUS_FILE, TF_STATUS_UNUSABLE: as tf_model_load(), of either file.
 */
enum tf_status tf_model_load_with_maps(const char *path,
                                       const char *maps,
                                       struct tf_model **out);

/**
 * Frees a model; null is allowed. What was made with it goes on working.
 */
void tf_model_free(struct tf_model *model);

/**
 * Loads a bank from its file, made with `tactile-infer bank`.
 * \param model the model that made the bank
 * TF_STATUS_WRONG_MODEL: another model made it. TF_STATUS_FILE, TF_STATUS_UNUSABLE: as for a model.
 */
enum tf_status tf_bank_load(const struct tf_model *model, const char *path, struct tf_bank **out);

/**
 * Frees a bank; null is allowed. What was made with it goes on working.
 */
void tf_bank_free(struct tf_bank *bank);

/**
 * The number of parts in a bank. Parts are numbered from 0.
 */
enum tf_status tf_bank_n_parts(const struct tf_bank *bank, size_t *n_parts);

/**
 * The name of a part, UTF-8. It belongs to the bank, and is valid until the bank is freed.
 */
enum tf_status tf_bank_part_name(const struct tf_bank *bank, size_t part, const char **name);

/**
 * The checksum of a bank as 64 hex digits without a zero at the end: what a saved episode is bound to.
 * \param required  where the number of bytes goes; with a capacity of 0 nothing else is written
 */
enum tf_status tf_bank_sha256(const struct tf_bank *bank, uint8_t *buffer, size_t capacity, size_t *required);

/**
 * A sensor that touches holes, and whose frame at rest, without contact, is `at_rest`.
 * TF_STATUS_FRAME_DARK, _SATURATED, _UNIFORM: that frame shows nothing. TF_STATUS_UNUSABLE: it is smaller than the model's
 * input.
 */
enum tf_status tf_sensor_new(const struct tf_model *model,
                             const struct tf_frame *at_rest,
                             struct tf_sensor **out);

/**
 * tf_sensor_new() of a sensor that touches this side. An episode is of one side: give tf_config_new() the same side. A touch
 * of the other side is refused with TF_STATUS_WRONG_SIDE.
 * \param touched  a value of tf_side
 */
enum tf_status tf_sensor_new_of_side(const struct tf_model *model,
                                     const struct tf_frame *at_rest,
                                     uint32_t touched,
                                     struct tf_sensor **out);

/**
 * The same sensor, whose lamps are known: its pictures are brought under the lamps that the network knows. Without it they
 * are taken to be a GelSight Mini's. The first sensor stays as it is.
 * TF_STATUS_UNUSABLE: lamps that do not show slopes in all directions.
 */
enum tf_status tf_sensor_lit_by(const struct tf_sensor *sensor,
                                const struct tf_lamps *lamps,
                                struct tf_sensor **out);

/**
 * Frees a sensor; null is allowed. What was made with it goes on working.
 */
void tf_sensor_free(struct tf_sensor *sensor);

/**
 * What a frame of a touch shows: some milliseconds of work, on the caller's thread.
 * \param out  where the handle goes, to be freed by tf_observation_free(); null after an error
 * TF_STATUS_FRAME_...: the frame cannot be used.
 */
enum tf_status tf_sensor_observe(const struct tf_sensor *sensor,
                                 const struct tf_frame *frame,
                                 struct tf_observation **out);

/**
 * Frees an observation; null is allowed.
 */
void tf_observation_free(struct tf_observation *observation);

/**
 * The share of the view that shows an edge, 0 to 1: 0 without contact, and on a flat face.
 */
enum tf_status tf_observation_edge_share(const struct tf_observation *observation, float *edge_share);

/**
 * Begins with nothing known.
 * \param at_rest  a frame of the sensor without contact
 * \param width_mm, height_mm  what a frame shows
 * \param out  where the handle goes, to be freed by tf_light_free(); null after an error
 * TF_STATUS_FRAME_...: that frame shows nothing. TF_STATUS_UNUSABLE: it is small, or shows no area.
 */
enum tf_status tf_light_new(const struct tf_frame *at_rest,
                            double width_mm,
                            double height_mm,
                            struct tf_light **out);

/**
 * Adds the frame of a touch, of any part, at any pose. One without an edge tells nothing.
 * TF_STATUS_FRAME_WRONG_SIZE: of another size than the one at rest.
 */
enum tf_status tf_light_add(struct tf_light *light, const struct tf_frame *frame);

/**
 * Learns the lamps where there are touches enough: 20 that show edges, and again after 40 and 80. Ask after each hole, and
 * give new lamps to tf_sensor_lit_by(); then forget what holes before have said (tf_config_forget_sensor()).
 * \param is_new  where 1 goes where lamps were learnt now, else 0
 * \param lamps  where they go; not written to where none were
 */
enum tf_status tf_light_learn(struct tf_light *light,
                              uint32_t *is_new,
                              struct tf_lamps *lamps);

/**
 * Frees it; null is allowed.
 */
void tf_light_free(struct tf_light *light);

/**
 * A config with what was measured of a model where this side is touched, and with every setting at its default. A model
 * without a calibration for pegs is believed as for holes.
 * \param touched  a value of tf_side
 * \param out      where the handle goes, to be freed by tf_config_free(); null after an error
 */
enum tf_status tf_config_new(const struct tf_model *model,
                             uint32_t touched,
                             struct tf_config **out);

/**
 * Frees a config; null is allowed. An episode or a runner that began with it goes on working.
 */
void tf_config_free(struct tf_config *config);

/**
 * Forgets what holes have told of the sensor (tf_episode_learn()): for a new gel or another camera.
 */
enum tf_status tf_config_forget_sensor(struct tf_config *config);

/**
 * Tells a config where the hole of the next episode is known to be before it is touched, from a camera or a drawing; the touches then decide
 * among places as likely as that. It is kept for all episodes that begin with this config, until it is changed or forgotten
 * (tf_config_forget_start()). Where an episode begins, TF_STATUS_CONFIG: no pose, no covariance, or one far from where the bank's parts may be
 * touched first.
 * \param part_from_first  pose of the sensor at the first touch, in the part's frame
 * \param covariance       of that pose over (x mm, y mm, theta rad), row by row, 9 numbers
 */
enum tf_status tf_config_know_start(struct tf_config *config,
                                    struct tf_pose part_from_first,
                                    const double *covariance);

/**
 * tf_config_know_start() from where the part is seen. Both poses are in any one frame, as the robot's base.
 * \param base_from_part   the part's pose
 * \param covariance       of that pose over (x mm, y mm, theta rad), row by row, 9 numbers
 * \param base_from_first  pose of the sensor at the first touch
 */
enum tf_status tf_config_know_part(struct tf_config *config,
                                   struct tf_pose base_from_part,
                                   const double *covariance,
                                   struct tf_pose base_from_first);

/**
 * Forgets where a hole is known to be: it may be anywhere.
 */
enum tf_status tf_config_forget_start(struct tf_config *config);

/**
 * Changes a setting.
 * \param name   its name, UTF-8
 * \param value  its value as text, UTF-8: "4", "0.95", "none"
 * TF_STATUS_CONFIG: no setting has the name, or the setting cannot have the value; tf_last_error() says which names or
 * values there are. TF_STATUS_ARGUMENT: a text that is not UTF-8. Settings that ask for too much effort together are
 * refused where an episode begins.
 */
enum tf_status tf_config_set(struct tf_config *config,
                             const char *name,
                             const char *value);

/**
 * Changes a setting as tf_config_set() does, from a number.
 * \param value  4.0 where the setting is a whole number, and 4.5 is refused; above 2^53 use tf_config_set(), as a double
 *               does not hold each whole number there
 */
enum tf_status tf_config_set_number(struct tf_config *config,
                                    const char *name,
                                    double value);

/**
 * A setting as the text that tf_config_set() takes: "none", or the shortest text that is read as the same number to the
 * bit.
 * \param required  where the number of bytes goes, the zero at the end included; with a capacity of 0 nothing else is
 *                  written
 * TF_STATUS_CONFIG, TF_STATUS_ARGUMENT: as for tf_config_set().
 */
enum tf_status tf_config_get(const struct tf_config *config,
                             const char *name,
                             char *buffer,
                             size_t capacity,
                             size_t *required);

/**
 * Begins with the first touch.
 * \param out  where the handle goes, to be freed by tf_episode_free(); null after an error
 * TF_STATUS_CONFIG: the settings together ask for too much effort. TF_STATUS_WRONG_MODEL: the observation is of another
 * model than the bank.
 */
enum tf_status tf_episode_begin(const struct tf_config *config,
                                const struct tf_bank *bank,
                                const struct tf_observation *observation,
                                struct tf_episode **out);

/**
 * Frees an episode; null is allowed.
 */
void tf_episode_free(struct tf_episode *episode);

/**
 * Takes in a touch.
 * \param moved  the motion really made since the last touch that was taken in, in the sensor's frame at that touch
 * After an error the episode is as before, and the motion counts towards the next touch.
 * TF_STATUS_FROZEN_FRAME, TF_STATUS_MOTION, TF_STATUS_WRONG_MODEL, TF_STATUS_OBSERVATION.
 */
enum tf_status tf_episode_observe(struct tf_episode *episode,
                                  struct tf_pose moved,
                                  const struct tf_observation *observation);

/**
 * Whether to stop, and if not, which motion to make. Changes nothing: asked again, it answers the same.
 * \param reach  the motions that the robot can make from here, in the sensor's frame
 * TF_STATUS_EMPTY_REACH: the episode should go on, and no motion of finite numbers was offered.
 */
enum tf_status tf_episode_decide(const struct tf_episode *episode,
                                 const struct tf_pose *reach,
                                 size_t n_reach,
                                 struct tf_decision *decision);

/**
 * Like tf_episode_decide(), with a limit on the time to choose the motion: once it is over, the best motion found so far is
 * taken. The answer then depends on the machine's speed.
 * \param limit_us  the limit, microseconds
 */
enum tf_status tf_episode_decide_within(const struct tf_episode *episode,
                                        const struct tf_pose *reach,
                                        size_t n_reach,
                                        uint64_t limit_us,
                                        struct tf_decision *decision);

/**
 * What is known now.
 * \param stop  where the reason to stop now goes, TF_STOP_NONE to go on; null is allowed
 */
enum tf_status tf_episode_estimate(const struct tf_episode *episode,
                                   struct tf_estimate *estimate,
                                   enum tf_stop *stop);

/**
 * Takes what this hole tells of the sensor into a config, where its part is named with confidence now: how well touches of
 * this sensor match. Begin the next hole of the run with that config, as long as gel and camera stay;
 * tf_config_forget_sensor() begins anew.
 * \param n_holes  where the number of holes goes that have told so far; null is allowed
 */
enum tf_status tf_episode_learn(const struct tf_episode *episode,
                                struct tf_config *config,
                                uint32_t *n_holes);

/**
 * The second most probable part now. Ask for it after TF_STOP_TOUCH_LIMIT and TF_STOP_NOTHING_TO_LEARN: the hole may
 * be that of either.
 * \param runner_up  where it goes; its has_part is 0 where no other part is left
 */
enum tf_status tf_episode_runner_up(const struct tf_episode *episode,
                                    struct tf_runner_up *runner_up);

/**
 * The probability of each part, in the bank's order; they sum to 1.
 * \param required  where the number of parts goes; with a capacity of 0 nothing else is written
 */
enum tf_status tf_episode_class_posterior(const struct tf_episode *episode,
                                          double *buffer,
                                          size_t capacity,
                                          size_t *required);

/**
 * The belief over one part: each pose of the grid and its probability, those of no probability too.
 * \param required  where the number of poses goes, the same for each part; with a capacity of 0 nothing else is written
 */
enum tf_status tf_episode_belief(const struct tf_episode *episode,
                                 size_t part,
                                 struct tf_state *buffer,
                                 size_t capacity,
                                 size_t *required);

/**
 * The peaks of the belief, the heaviest first; those below 1 % are left out.
 * \param required  where their number goes; with a capacity of 0 nothing else is written
 */
enum tf_status tf_episode_modes(const struct tf_episode *episode,
                                struct tf_mode *buffer,
                                size_t capacity,
                                size_t *required);

/**
 * The episode as JSON in UTF-8, without a zero at the end: what is needed to go on later, or elsewhere.
 * \param required  where the number of bytes goes; with a capacity of 0 nothing else is written
 */
enum tf_status tf_episode_record(const struct tf_episode *episode,
                                 uint8_t *buffer,
                                 size_t capacity,
                                 size_t *required);

/**
 * An episode as it was when recorded, to the bit.
 * \param json    what tf_episode_record() wrote
 * \param length  its length, bytes
 * TF_STATUS_ARGUMENT: no record. TF_STATUS_WRONG_BANK: one of another bank or version.
 */
enum tf_status tf_episode_restore(const struct tf_bank *bank,
                                  const uint8_t *json,
                                  size_t length,
                                  struct tf_episode **out);

/**
 * Where to slide the peg of the named part along the plate until it goes in. Each offset is by what the peg is moved from where its hole
 * is believed to be, in the part's frame: its pose from the sensor is tf_pose_compose(tf_pose_inverse(estimate.part_from_sensor),
 * offset). The likeliest comes first; the first is no motion. They are as near to each other as the play asks for.
 * \param covered   where the probability goes that the peg goes in at one of them, if its hole is near; null is allowed
 * \param required  where the number of offsets goes; with a capacity of 0 no offset is written
 * TF_STATUS_CONFIG: a play or a radius that is not above zero, or a covariance that is none.
 */
enum tf_status tf_episode_search(const struct tf_episode *episode,
                                 const struct tf_held_peg *peg,
                                 double *covered,
                                 struct tf_pose *buffer,
                                 size_t capacity,
                                 size_t *required);

/**
 * Takes in that the peg of the named part went in at none of the offsets that tf_episode_search() gives now for the same peg: the hole is
 * another part's, or elsewhere, or was missed. Touch again before the next try.
 * TF_STATUS_CONFIG: as tf_episode_search().
 */
enum tf_status tf_episode_did_not_fit(struct tf_episode *episode,
                                      const struct tf_held_peg *peg);

/**
 * How well it is known where the named part is against where it is believed to be: covariance over (x mm, y mm, theta rad) in the part's
 * frame, row by row. Of an episode of touches of a held peg it is the covariance of that peg in the hand.
 * \param covariance  where the 9 numbers go
 */
enum tf_status tf_episode_offset_covariance(const struct tf_episode *episode,
                                            double *covariance);

/**
 * Starts a thread that takes in touches and decides. It keeps what it needs of sensor and bank: both may be freed.
 * \param capacity  the most jobs without a polled outcome, 1 to 1024
 * \param out       where the handle goes, to be freed by tf_runner_free(); null after an error
 */
enum tf_status tf_runner_start(const struct tf_sensor *sensor,
                               const struct tf_bank *bank,
                               const struct tf_config *config,
                               size_t capacity,
                               struct tf_runner **out);

/**
 * Stops the thread and frees the runner; null is allowed. Waits for the job that is being done, some milliseconds; those
 * that wait are not done.
 */
void tf_runner_free(struct tf_runner *runner);

/**
 * Hands in a touch; the first one begins the episode. Copies the frame and the reach, and never waits.
 * \param moved   the motion really made since the touch submitted before, in the sensor's frame at that touch. The runner
 *                itself adds up the motions of touches that were refused
 * \param reach   the motions that the robot can make from here, in the sensor's frame at this touch
 * \param ticket  where the number of the job goes: 0, then 1, 2 ...; null is allowed
 * TF_STATUS_QUEUE_FULL: the runner has as many jobs without a polled outcome as it may have; poll, and try again.
 */
enum tf_status tf_runner_submit_touch(struct tf_runner *runner,
                                      const struct tf_frame *frame,
                                      struct tf_pose moved,
                                      const struct tf_pose *reach,
                                      size_t n_reach,
                                      uint64_t *ticket);

/**
 * Asks for the estimate after the touches submitted so far.
 * \param ticket  as for tf_runner_submit_touch()
 */
enum tf_status tf_runner_submit_estimate(struct tf_runner *runner, uint64_t *ticket);

/**
 * Forgets the touches: the next one begins an episode.
 * \param config  what it runs with; null: as before
 * \param ticket  as for tf_runner_submit_touch()
 */
enum tf_status tf_runner_submit_new_episode(struct tf_runner *runner,
                                            const struct tf_config *config,
                                            uint64_t *ticket);

/**
 * A new frame at rest, for all touches submitted from now on. After an error the one before stays.
 * \param ticket  as for tf_runner_submit_touch()
 */
enum tf_status tf_runner_submit_rest(struct tf_runner *runner,
                                     const struct tf_frame *at_rest,
                                     uint64_t *ticket);

/**
 * The outcome of the earliest job that has none yet, where it is done; else one of the kind TF_OUTCOME_KIND_NONE. Never
 * waits. Every job gets exactly one outcome, in the order in which they were submitted.
 */
enum tf_status tf_runner_poll(struct tf_runner *runner,
                              struct tf_outcome *outcome);

/**
 * The second most probable part of the latest outcome that tf_runner_poll() gave, where that holds an estimate: see
 * tf_episode_runner_up().
 * \param runner_up  where it goes; its has_part is 0 where that outcome holds no estimate, or no other part is left
 */
enum tf_status tf_runner_runner_up(const struct tf_runner *runner,
                                   struct tf_runner_up *runner_up);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* TACTILE_FILTER_H */
