// The filter for C++17: handles that free themselves, errors as exceptions, lists as std::vector.
//
// Nothing but a thin layer over tactile_filter.h, whose comments say what each call does; its plain structs are used as they
// are. Handles can be moved and not copied. An empty handle (moved from, or made by the default constructor) gives
// TF_STATUS_NULL_POINTER wherever it is used.
//
// Errors throw tactile_filter::Error, which knows its tf_status. With TACTILE_FILTER_NO_EXCEPTIONS defined, or without
// exceptions in the compiler, each call returns a Result instead: ask ok() before value().
#ifndef TACTILE_FILTER_HPP
#define TACTILE_FILTER_HPP

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "tactile_filter.h"

#if !defined(__cpp_exceptions) && !defined(_CPPUNWIND) && !defined(TACTILE_FILTER_NO_EXCEPTIONS)
#define TACTILE_FILTER_NO_EXCEPTIONS
#endif

#ifndef TACTILE_FILTER_NO_EXCEPTIONS
#include <stdexcept>
#endif

namespace tactile_filter {

#ifdef TACTILE_FILTER_NO_EXCEPTIONS

// What a call gives, or why it failed.
template <class T>
class [[nodiscard]] Result {
public:
    Result(tf_status status, T value)
        : status_(status), message_(status == TF_STATUS_OK ? "" : tf_last_error()), value_(std::move(value)) {}

    bool ok() const { return status_ == TF_STATUS_OK; }
    tf_status status() const { return status_; }
    // What was expected and what came, in one line.
    const std::string &message() const { return message_; }
    // Only where ok(); else an empty handle, zeros or an empty list.
    T &value() & { return value_; }
    const T &value() const & { return value_; }
    T &&value() && { return std::move(value_); }

private:
    tf_status status_;
    std::string message_;
    T value_;
};

// What a call without a value gives.
struct Nothing {};
using Done = Result<Nothing>;

namespace detail {
template <class T>
Result<T> give(tf_status status, T value) { return Result<T>(status, std::move(value)); }
inline Done done(tf_status status) { return Done(status, Nothing{}); }
}  // namespace detail

#else

// Why a call failed: what() says what was expected and what came, in one line.
class Error : public std::runtime_error {
public:
    explicit Error(tf_status status) : std::runtime_error(tf_last_error()), status_(status) {}
    Error(tf_status status, const char *message) : std::runtime_error(message), status_(status) {}
    tf_status status() const noexcept { return status_; }

private:
    tf_status status_;
};

template <class T>
using Result = T;
using Done = void;

namespace detail {
inline void done(tf_status status)
{
    if (status != TF_STATUS_OK) {
        throw Error(status);
    }
}
template <class T>
T give(tf_status status, T value)
{
    done(status);
    return value;
}
}  // namespace detail

#endif

namespace detail {

template <class T, void (*free_handle)(T *)>
struct Free {
    void operator()(T *handle) const noexcept { free_handle(handle); }
};

template <class T, void (*free_handle)(T *)>
using Handle = std::unique_ptr<T, Free<T, free_handle>>;

// Asks for the length, then for the values; again where another thread changed the length in between. The last `n_closing`
// values, a text's zero, are left out.
template <class List, class Ask>
Result<List> list(Ask ask, std::size_t n_closing = 0)
{
    List values;
    std::size_t n = 0;
    tf_status status = ask(nullptr, std::size_t{0}, &n);
    while (status == TF_STATUS_OK || status == TF_STATUS_BUFFER_TOO_SMALL) {
        values.resize(n);
        status = ask(values.data(), values.size(), &n);
        if (status == TF_STATUS_OK) {
            values.resize(n - n_closing);
            break;
        }
    }
    return give(status, std::move(values));
}

// A runner-up, where there is one.
inline Result<std::optional<tf_runner_up>> perhaps(tf_status status, const tf_runner_up &runner_up)
{
    const bool is_one = status == TF_STATUS_OK && runner_up.has_part != 0;
    return give(status, is_one ? std::optional<tf_runner_up>(runner_up) : std::nullopt);
}

}  // namespace detail

// Whether the library is the one that this header belongs to. Ask once, at the start.
inline bool is_compatible() { return tf_abi_version() == TF_ABI_VERSION; }

// A picture; its pixels stay the caller's. Without a stride rows follow each other closely.
inline tf_frame frame(const std::uint8_t *pixels, std::size_t width_px, std::size_t height_px,
                      tf_format format = TF_FORMAT_RGB8, std::size_t stride_bytes = 0)
{
    const std::size_t stride = stride_bytes != 0 ? stride_bytes : 3 * width_px;
    return tf_frame{pixels, width_px, height_px, stride, static_cast<std::uint32_t>(format)};
}

// The name of the most probable part; valid as long as the episode or runner that gave the estimate.
inline std::string_view name(const tf_estimate &estimate)
{
    return estimate.part_name != nullptr ? std::string_view(estimate.part_name) : std::string_view();
}

// The name of the second most probable part; valid as long as the episode that gave it.
inline std::string_view name(const tf_runner_up &runner_up)
{
    return runner_up.part_name != nullptr ? std::string_view(runner_up.part_name) : std::string_view();
}

// The poses that touch cannot tell from the estimate's, itself first: insert at any of them.
inline Result<std::vector<tf_pose>> twins(const tf_estimate &estimate)
{
    return detail::list<std::vector<tf_pose>>([&](tf_pose *buffer, std::size_t capacity, std::size_t *required) {
        return tf_estimate_twins(&estimate, buffer, capacity, required);
    });
}

// What an episode runs with: what was measured of a model, and settings by name. Model::config() makes it.
class Config {
public:
    Config() = default;

    // Changes a setting from its text: "4", "0.95", "none".
    Done set(const std::string &name, const char *value)
    {
        return detail::done(tf_config_set(handle_.get(), name.c_str(), value));
    }
    Done set(const std::string &name, const std::string &value) { return set(name, value.c_str()); }

    // The same from a number; a whole one is taken exactly.
    Done set(const std::string &name, double value)
    {
        return detail::done(tf_config_set_number(handle_.get(), name.c_str(), value));
    }
    template <class Whole, std::enable_if_t<std::is_integral_v<Whole>, int> = 0>
    Done set(const std::string &name, Whole value)
    {
        return set(name, std::to_string(value));
    }

    // A setting as text: "none", or the shortest that is read as the same number to the bit.
    Result<std::string> get(const std::string &name) const
    {
        const auto ask = [&](char *buffer, std::size_t capacity, std::size_t *required) {
            return tf_config_get(get(), name.c_str(), buffer, capacity, required);
        };
        return detail::list<std::string>(ask, 1);
    }

    // Where the hole of the next episode is known to be, from a camera or a drawing: the sensor's pose at its first touch on the part,
    // and its covariance over (x mm, y mm, theta rad), row by row.
    Done know_start(const tf_pose &part_from_first, const std::array<double, 9> &covariance)
    {
        return detail::done(tf_config_know_start(handle_.get(), part_from_first, covariance.data()));
    }
    // The same from where the part is seen, both poses in any one frame.
    Done know_part(const tf_pose &base_from_part, const std::array<double, 9> &covariance, const tf_pose &base_from_first)
    {
        return detail::done(tf_config_know_part(handle_.get(), base_from_part, covariance.data(), base_from_first));
    }
    // The hole may be anywhere.
    Done forget_start() { return detail::done(tf_config_forget_start(handle_.get())); }

    // Forgets what holes have told of the sensor: for a new gel or another camera.
    Done forget_sensor() { return detail::done(tf_config_forget_sensor(handle_.get())); }

    const tf_config *get() const { return handle_.get(); }
    tf_config *get() { return handle_.get(); }

private:
    friend class Model;
    explicit Config(tf_config *handle) : handle_(handle) {}
    detail::Handle<tf_config, tf_config_free> handle_;
};

// A trained network.
class Model {
public:
    Model() = default;

    static Result<Model> load(const std::string &path)
    {
        tf_model *handle = nullptr;
        const tf_status status = tf_model_load(path.c_str(), &handle);
        return detail::give(status, Model(handle));
    }

    // With networks that draw a map of each touch and judge by them.
    static Result<Model> load(const std::string &path, const std::string &maps)
    {
        tf_model *handle = nullptr;
        const tf_status status = tf_model_load_with_maps(path.c_str(), maps.c_str(), &handle);
        return detail::give(status, Model(handle));
    }

    // What was measured of it where this side is touched, with every setting at its default.
    Result<Config> config(tf_side side = TF_SIDE_HOLE) const
    {
        tf_config *handle = nullptr;
        const tf_status status = tf_config_new(get(), static_cast<std::uint32_t>(side), &handle);
        return detail::give(status, Config(handle));
    }

    const tf_model *get() const { return handle_.get(); }

private:
    explicit Model(tf_model *handle) : handle_(handle) {}
    detail::Handle<tf_model, tf_model_free> handle_;
};

// The recorded views of the parts.
class Bank {
public:
    Bank() = default;

    static Result<Bank> load(const Model &model, const std::string &path)
    {
        tf_bank *handle = nullptr;
        const tf_status status = tf_bank_load(model.get(), path.c_str(), &handle);
        return detail::give(status, Bank(handle));
    }

    // The names of its parts, in order; valid as long as the bank.
    Result<std::vector<std::string_view>> parts() const
    {
        std::vector<std::string_view> names;
        std::size_t n_parts = 0;
        tf_status status = tf_bank_n_parts(get(), &n_parts);
        for (std::size_t part = 0; status == TF_STATUS_OK && part < n_parts; part++) {
            const char *name = nullptr;
            status = tf_bank_part_name(get(), part, &name);
            if (status == TF_STATUS_OK) {
                names.emplace_back(name);
            }
        }
        return detail::give(status, std::move(names));
    }

    // Its checksum, 64 hex digits: what a saved episode is bound to.
    Result<std::string> sha256() const
    {
        return detail::list<std::string>([&](char *buffer, std::size_t capacity, std::size_t *required) {
            return tf_bank_sha256(get(), reinterpret_cast<std::uint8_t *>(buffer), capacity, required);
        });
    }

    const tf_bank *get() const { return handle_.get(); }

private:
    explicit Bank(tf_bank *handle) : handle_(handle) {}
    detail::Handle<tf_bank, tf_bank_free> handle_;
};

// What the filter takes in of one touch.
class Observation {
public:
    Observation() = default;

    // The share of the view that shows an edge, 0 to 1.
    Result<float> edge_share() const
    {
        float share = 0.0F;
        const tf_status status = tf_observation_edge_share(get(), &share);
        return detail::give(status, share);
    }

    const tf_observation *get() const { return handle_.get(); }

private:
    friend class Sensor;
    explicit Observation(tf_observation *handle) : handle_(handle) {}
    detail::Handle<tf_observation, tf_observation_free> handle_;
};

// The camera, the gel and its frame at rest, bound to a model.
class Sensor {
public:
    Sensor() = default;

    // Touches holes, or raised parts that are recognised among the bank's own.
    static Result<Sensor> create(const Model &model, const tf_frame &at_rest, tf_side side = TF_SIDE_HOLE)
    {
        tf_sensor *handle = nullptr;
        const auto touched = static_cast<std::uint32_t>(side);
        const tf_status status = tf_sensor_new_of_side(model.get(), &at_rest, touched, &handle);
        return detail::give(status, Sensor(handle));
    }

    // The same sensor with known lamps: its pictures are brought under those that the network knows.
    Result<Sensor> lit_by(const tf_lamps &lamps) const
    {
        tf_sensor *handle = nullptr;
        const tf_status status = tf_sensor_lit_by(get(), &lamps, &handle);
        return detail::give(status, Sensor(handle));
    }

    // What a frame of a touch shows.
    Result<Observation> observe(const tf_frame &frame) const
    {
        tf_observation *handle = nullptr;
        const tf_status status = tf_sensor_observe(get(), &frame, &handle);
        return detail::give(status, Observation(handle));
    }

    const tf_sensor *get() const { return handle_.get(); }

private:
    explicit Sensor(tf_sensor *handle) : handle_(handle) {}
    detail::Handle<tf_sensor, tf_sensor_free> handle_;
};

// The lamps of a sensor that nobody calibrated, learnt from its touches of anything.
class Light {
public:
    Light() = default;

    static Result<Light> create(const tf_frame &at_rest, double width_mm, double height_mm)
    {
        tf_light *handle = nullptr;
        const tf_status status = tf_light_new(&at_rest, width_mm, height_mm, &handle);
        return detail::give(status, Light(handle));
    }

    // Adds the frame of a touch, of any part, at any pose.
    Done add(const tf_frame &frame) { return detail::done(tf_light_add(get(), &frame)); }

    // The lamps, where there are touches enough to learn them now: for Sensor::lit_by().
    Result<std::optional<tf_lamps>> learn()
    {
        std::uint32_t is_new = 0;
        tf_lamps lamps{};
        const tf_status status = tf_light_learn(get(), &is_new, &lamps);
        return detail::give(status, is_new != 0 ? std::optional<tf_lamps>(lamps) : std::nullopt);
    }

    tf_light *get() const { return handle_.get(); }

private:
    explicit Light(tf_light *handle) : handle_(handle) {}
    detail::Handle<tf_light, tf_light_free> handle_;
};

// One hole being identified.
class Episode {
public:
    Episode() = default;

    // Begins with the first touch.
    static Result<Episode> begin(const Config &config, const Bank &bank, const Observation &observation)
    {
        tf_episode *handle = nullptr;
        const tf_status status = tf_episode_begin(config.get(), bank.get(), observation.get(), &handle);
        return detail::give(status, Episode(handle));
    }

    // An episode as it was when recorded, to the bit.
    static Result<Episode> restore(const Bank &bank, std::string_view json)
    {
        tf_episode *handle = nullptr;
        const auto *bytes = reinterpret_cast<const std::uint8_t *>(json.data());
        const tf_status status = tf_episode_restore(bank.get(), bytes, json.size(), &handle);
        return detail::give(status, Episode(handle));
    }

    // Takes in a touch after the motion that was really made.
    Done observe(const tf_pose &moved, const Observation &observation)
    {
        return detail::done(tf_episode_observe(handle_.get(), moved, observation.get()));
    }

    // Where to slide the peg of the named part until it goes in, the likeliest first: tf_episode_search().
    Result<std::vector<tf_pose>> search(const tf_held_peg &peg) const
    {
        return detail::list<std::vector<tf_pose>>([&](tf_pose *buffer, std::size_t capacity, std::size_t *required) {
            return tf_episode_search(get(), &peg, nullptr, buffer, capacity, required);
        });
    }

    // Takes in that the peg went in nowhere there.
    Done did_not_fit(const tf_held_peg &peg)
    {
        return detail::done(tf_episode_did_not_fit(handle_.get(), &peg));
    }

    // How well it is known where the named part is; of touches of a held peg, tf_held_peg's covariance.
    Result<std::array<double, 9>> offset_covariance() const
    {
        std::array<double, 9> covariance{};
        const tf_status status = tf_episode_offset_covariance(get(), covariance.data());
        return detail::give(status, covariance);
    }

    // Whether to stop, and if not, which motion of the reach to make.
    Result<tf_decision> decide(const std::vector<tf_pose> &reach) const
    {
        tf_decision decision{};
        const tf_status status = tf_episode_decide(get(), reach.data(), reach.size(), &decision);
        return detail::give(status, decision);
    }

    // The same, with the best motion found within a time.
    Result<tf_decision> decide_within(const std::vector<tf_pose> &reach, std::chrono::microseconds limit) const
    {
        tf_decision decision{};
        const auto us = limit.count() < 0 ? std::uint64_t{0} : static_cast<std::uint64_t>(limit.count());
        const tf_status status = tf_episode_decide_within(get(), reach.data(), reach.size(), us, &decision);
        return detail::give(status, decision);
    }

    // What is known now.
    Result<tf_estimate> estimate() const
    {
        tf_estimate estimate{};
        const tf_status status = tf_episode_estimate(get(), &estimate, nullptr);
        return detail::give(status, estimate);
    }

    // Takes what this hole tells of the sensor into the config for the next; gives how many holes have told so far.
    Result<std::uint32_t> learn(Config &config) const
    {
        std::uint32_t n_holes = 0;
        const tf_status status = tf_episode_learn(get(), config.get(), &n_holes);
        return detail::give(status, n_holes);
    }

    // Why to stop now; TF_STOP_NONE to go on.
    Result<tf_stop> stop() const
    {
        tf_estimate estimate{};
        tf_stop stop = TF_STOP_NONE;
        const tf_status status = tf_episode_estimate(get(), &estimate, &stop);
        return detail::give(status, stop);
    }

    // The second most probable part; nothing where no other part is left.
    Result<std::optional<tf_runner_up>> runner_up() const
    {
        tf_runner_up runner_up{};
        const tf_status status = tf_episode_runner_up(get(), &runner_up);
        return detail::perhaps(status, runner_up);
    }

    // The probability of each part, in the bank's order.
    Result<std::vector<double>> class_posterior() const
    {
        return detail::list<std::vector<double>>([&](double *buffer, std::size_t capacity, std::size_t *required) {
            return tf_episode_class_posterior(get(), buffer, capacity, required);
        });
    }

    // The belief over one part: each pose of the grid and its probability.
    Result<std::vector<tf_state>> belief(std::size_t part) const
    {
        return detail::list<std::vector<tf_state>>([&](tf_state *buffer, std::size_t capacity, std::size_t *required) {
            return tf_episode_belief(get(), part, buffer, capacity, required);
        });
    }

    // The peaks of the belief, the heaviest first.
    Result<std::vector<tf_mode>> modes() const
    {
        return detail::list<std::vector<tf_mode>>([&](tf_mode *buffer, std::size_t capacity, std::size_t *required) {
            return tf_episode_modes(get(), buffer, capacity, required);
        });
    }

    // The episode as JSON: what is needed to go on later, or elsewhere.
    Result<std::string> record() const
    {
        return detail::list<std::string>([&](char *buffer, std::size_t capacity, std::size_t *required) {
            return tf_episode_record(get(), reinterpret_cast<std::uint8_t *>(buffer), capacity, required);
        });
    }

    const tf_episode *get() const { return handle_.get(); }

private:
    explicit Episode(tf_episode *handle) : handle_(handle) {}
    detail::Handle<tf_episode, tf_episode_free> handle_;
};

// An episode on a thread of its own: no call waits but the destructor, which ends the thread.
class Runner {
public:
    Runner() = default;

    static Result<Runner> start(const Sensor &sensor, const Bank &bank, const Config &config, std::size_t capacity)
    {
        tf_runner *handle = nullptr;
        const tf_status status = tf_runner_start(sensor.get(), bank.get(), config.get(), capacity, &handle);
        return detail::give(status, Runner(handle));
    }

    // Hands in a touch. Gives its ticket, or nothing where the queue is full: poll, and try again.
    Result<std::optional<std::uint64_t>> submit(const tf_frame &frame, const tf_pose &moved,
                                                const std::vector<tf_pose> &reach)
    {
        std::uint64_t ticket = 0;
        return given(tf_runner_submit_touch(handle_.get(), &frame, moved, reach.data(), reach.size(), &ticket), ticket);
    }

    // Asks for the estimate after the touches submitted so far.
    Result<std::optional<std::uint64_t>> submit_estimate()
    {
        std::uint64_t ticket = 0;
        return given(tf_runner_submit_estimate(handle_.get(), &ticket), ticket);
    }

    // The next touch begins an episode, with the config before.
    Result<std::optional<std::uint64_t>> submit_new_episode()
    {
        std::uint64_t ticket = 0;
        return given(tf_runner_submit_new_episode(handle_.get(), nullptr, &ticket), ticket);
    }

    // The next touch begins an episode, with this config.
    Result<std::optional<std::uint64_t>> submit_new_episode(const Config &config)
    {
        std::uint64_t ticket = 0;
        if (config.get() == nullptr) {  // Null would be the config before: have it refused as everywhere.
            return given(tf_config_get(nullptr, nullptr, nullptr, 0, nullptr), ticket);
        }
        return given(tf_runner_submit_new_episode(handle_.get(), config.get(), &ticket), ticket);
    }

    // A new frame at rest.
    Result<std::optional<std::uint64_t>> submit_rest(const tf_frame &at_rest)
    {
        std::uint64_t ticket = 0;
        return given(tf_runner_submit_rest(handle_.get(), &at_rest, &ticket), ticket);
    }

    // The next outcome, where there is one. Of the kind TF_OUTCOME_KIND_ERROR: tf_last_error() says it in words.
    Result<std::optional<tf_outcome>> poll()
    {
        tf_outcome outcome{};
        const tf_status status = tf_runner_poll(handle_.get(), &outcome);
        const bool is_one = status == TF_STATUS_OK && outcome.kind != TF_OUTCOME_KIND_NONE;
        return detail::give(status, is_one ? std::optional<tf_outcome>(outcome) : std::nullopt);
    }

    // The second most probable part of the latest outcome, where that holds an estimate; nothing where no other part is left.
    Result<std::optional<tf_runner_up>> runner_up() const
    {
        tf_runner_up runner_up{};
        const tf_status status = tf_runner_runner_up(handle_.get(), &runner_up);
        return detail::perhaps(status, runner_up);
    }

private:
    explicit Runner(tf_runner *handle) : handle_(handle) {}

    static Result<std::optional<std::uint64_t>> given(tf_status status, std::uint64_t ticket)
    {
        if (status == TF_STATUS_QUEUE_FULL) {
            return detail::give(TF_STATUS_OK, std::optional<std::uint64_t>());
        }
        return detail::give(status, std::optional<std::uint64_t>(ticket));
    }

    detail::Handle<tf_runner, tf_runner_free> handle_;
};

}  // namespace tactile_filter

#endif  // TACTILE_FILTER_HPP
