// The wrapper without exceptions: each call returns a Result. ./wrapper FOLDER, a folder with a model, as the example `record`
// makes it. Compiled by compiled.rs, and run by `cargo xtask capi`.
#define TACTILE_FILTER_NO_EXCEPTIONS
#include "tactile_filter.hpp"

#include <cstdio>
#include <limits>
#include <type_traits>

namespace tf = tactile_filter;

static_assert(std::is_nothrow_move_constructible_v<tf::Episode> && !std::is_copy_constructible_v<tf::Episode>);
static_assert(std::is_nothrow_move_assignable_v<tf::Runner> && !std::is_copy_assignable_v<tf::Runner>);
static_assert(std::is_nothrow_move_constructible_v<tf::Config> && !std::is_copy_constructible_v<tf::Config>);
static_assert(sizeof(tf::Model) == sizeof(void *));

namespace {

int n_wrong = 0;

void expect(bool holds) { n_wrong += holds ? 0 : 1; }

void expect_setting(const tf::Config &config, const char *name, const char *expected)
{
    const auto got = config.get(name);
    if (!got.ok() || got.value() != expected) {
        std::fprintf(stderr, "%s: expected %s, got %s %s\n", name, expected, got.value().c_str(), got.message().c_str());
        n_wrong++;
    }
}

// Whole numbers of any type, other numbers and texts; what is wrong is refused and changes nothing.
void settings(const std::string &folder)
{
    const auto model = tf::Model::load(folder + "/model.safetensors");
    auto made = model.value().config(TF_SIDE_PEG);
    expect(made.ok());
    tf::Config config = std::move(made.value());
    expect(config.set("max_touches", 4).ok() && config.set("n_draws", std::uint8_t{200}).ok());
    expect(config.set("seed", std::numeric_limits<std::uint64_t>::max()).ok());
    expect(config.set("stop_probability", 0.99F).ok() && config.set("travel_nats_per_mm", 0.1).ok());
    expect(config.set("false_accept", "none").ok() && config.set("stop_place_mm", std::string("0.25")).ok());
    for (int round = 0; round < 2; round++) {
        expect_setting(config, "max_touches", "4");
        expect_setting(config, "n_draws", "200");
        expect_setting(config, "seed", "18446744073709551615");
        expect_setting(config, "stop_probability", "0.9900000095367432");
        expect_setting(config, "travel_nats_per_mm", "0.1");
        expect_setting(config, "false_accept", "none");
        expect_setting(config, "stop_place_mm", "0.25");
        expect(config.set("max_touches", -1).status() == TF_STATUS_CONFIG);
        expect(config.set("max_touches", 4.5).status() == TF_STATUS_CONFIG);
        expect(config.set("n_draws", "\xff").status() == TF_STATUS_ARGUMENT);
        expect(config.set("seed", static_cast<const char *>(nullptr)).status() == TF_STATUS_NULL_POINTER);
        expect(config.set("seeds", 1).status() == TF_STATUS_CONFIG && !config.get("seeds").ok());
    }
    const tf::Config moved_to = std::move(config);
    expect_setting(moved_to, "max_touches", "4");
    expect(config.set("seed", 1).status() == TF_STATUS_NULL_POINTER);  // NOLINT: an empty handle is what is tried.
}

}  // namespace

int main(int argc, char **argv)
{
    if (argc != 2) {
        std::fprintf(stderr, "usage: wrapper FOLDER\n");
        return 2;
    }
    settings(argv[1]);
    const tf::Model none;
    const auto model = tf::Model::load("no such file");
    expect(!model.ok() && model.status() == TF_STATUS_FILE && !model.message().empty());
    // Every call on an empty handle is an error, and no crash.
    expect(none.config().status() == TF_STATUS_NULL_POINTER);
    expect(tf::Bank::load(none, "x").status() == TF_STATUS_NULL_POINTER);
    const tf::Bank bank;
    expect(bank.parts().status() == TF_STATUS_NULL_POINTER && bank.sha256().status() == TF_STATUS_NULL_POINTER);
    const std::uint8_t pixels[12] = {};
    expect(tf::Sensor::create(none, tf::frame(pixels, 2, 2)).status() == TF_STATUS_NULL_POINTER);
    const tf::Sensor sensor;
    expect(sensor.observe(tf::frame(pixels, 2, 2, TF_FORMAT_BGR8)).status() == TF_STATUS_NULL_POINTER);
    expect(tf::Light::create(tf::frame(pixels, 2, 2), 18.6, 14.3).status() == TF_STATUS_FRAME_DARK);
    tf::Light light;
    expect(!light.add(tf::frame(pixels, 2, 2)).ok() && light.learn().status() == TF_STATUS_NULL_POINTER);
    const tf::Observation observation;
    expect(observation.edge_share().status() == TF_STATUS_NULL_POINTER);
    tf::Config config;
    expect(config.set("seed", 1).status() == TF_STATUS_NULL_POINTER);
    expect(config.set("seed", 1.0).status() == TF_STATUS_NULL_POINTER);
    expect(config.know_start(tf_pose{}, {}).status() == TF_STATUS_NULL_POINTER);
    expect(config.know_part(tf_pose{}, {}, tf_pose{}).status() == TF_STATUS_NULL_POINTER);
    expect(config.forget_start().status() == TF_STATUS_NULL_POINTER);
    expect(config.get("seed").status() == TF_STATUS_NULL_POINTER && config.get("seed").value().empty());
    expect(!tf::Episode::begin(config, bank, observation).ok() && !tf::Episode::restore(bank, "{}").ok());
    tf::Episode episode;
    const std::vector<tf_pose> reach(3);
    expect(!episode.observe(tf_pose{}, observation).ok() && !episode.decide(reach).ok());
    expect(!episode.decide_within(reach, std::chrono::milliseconds(1)).ok() && !episode.estimate().ok());
    expect(!episode.stop().ok() && !episode.class_posterior().ok() && !episode.belief(0).ok());
    expect(!episode.modes().ok() && episode.record().status() == TF_STATUS_NULL_POINTER);
    expect(episode.search(tf_held_peg{}).status() == TF_STATUS_NULL_POINTER && !episode.did_not_fit(tf_held_peg{}).ok());
    expect(episode.offset_covariance().status() == TF_STATUS_NULL_POINTER);
    const auto runner_up = episode.runner_up();
    expect(runner_up.status() == TF_STATUS_NULL_POINTER && !runner_up.value() && tf::name(tf_runner_up{}).empty());
    expect(!tf::Runner::start(sensor, bank, config, 1).ok());
    tf::Runner runner;
    expect(!runner.submit(tf::frame(pixels, 2, 2), tf_pose{}, reach).ok() && !runner.submit_estimate().ok());
    expect(!runner.submit_new_episode().ok());
    expect(runner.submit_new_episode(config).message().rfind("config: ", 0) == 0);
    expect(!runner.submit_rest(tf::frame(pixels, 2, 2)).ok() && !runner.poll().ok() && !runner.runner_up().ok());
    tf_estimate estimate{};
    expect(tf::twins(estimate).status() == TF_STATUS_ARGUMENT && tf::name(estimate).empty());
    estimate.symmetry_order = 2;
    const auto twins = tf::twins(estimate);
    expect(twins.ok() && twins.value().size() == 2);
    estimate.symmetry_order = TF_ROUND;
    expect(tf::twins(estimate).ok() && tf::twins(estimate).value().size() == 36);
    return n_wrong;
}
