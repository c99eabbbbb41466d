// The wrapper without exceptions: each call returns a Result. Compiled by compiled.rs, and run by `cargo xtask capi`.
#define TACTILE_FILTER_NO_EXCEPTIONS
#include "tactile_filter.hpp"

#include <type_traits>

namespace tf = tactile_filter;

static_assert(std::is_nothrow_move_constructible_v<tf::Episode> && !std::is_copy_constructible_v<tf::Episode>);
static_assert(std::is_nothrow_move_assignable_v<tf::Runner> && !std::is_copy_assignable_v<tf::Runner>);
static_assert(sizeof(tf::Model) == sizeof(void *));

int main()
{
    int n_wrong = 0;
    const auto expect = [&](bool holds) { n_wrong += holds ? 0 : 1; };
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
    const tf::Observation observation;
    expect(observation.edge_share().status() == TF_STATUS_NULL_POINTER);
    const tf_episode_config config{};
    expect(!tf::Episode::begin(config, bank, observation).ok() && !tf::Episode::restore(bank, "{}").ok());
    tf::Episode episode;
    const std::vector<tf_pose> reach(3);
    expect(!episode.observe(tf_pose{}, observation).ok() && !episode.decide(reach).ok());
    expect(!episode.decide_within(reach, std::chrono::milliseconds(1)).ok() && !episode.estimate().ok());
    expect(!episode.stop().ok() && !episode.class_posterior().ok() && !episode.belief(0).ok());
    expect(!episode.modes().ok() && episode.record().status() == TF_STATUS_NULL_POINTER);
    const auto runner_up = episode.runner_up();
    expect(runner_up.status() == TF_STATUS_NULL_POINTER && !runner_up.value() && tf::name(tf_runner_up{}).empty());
    expect(!tf::Runner::start(sensor, bank, config, 1).ok());
    tf::Runner runner;
    expect(!runner.submit(tf::frame(pixels, 2, 2), tf_pose{}, reach).ok() && !runner.submit_estimate().ok());
    expect(!runner.submit_new_episode().ok() && !runner.submit_new_episode(config).ok());
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
