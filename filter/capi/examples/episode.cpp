// One whole episode with a robot whose touches were recorded, first on this thread, then on a runner's: ./episode FOLDER
// The folder is made by: cargo run --release --package tactile-capi --example record -- FOLDER
#include <chrono>
#include <cstdio>
#include <exception>
#include <fstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tactile_filter.hpp"

namespace tf = tactile_filter;

namespace {

struct Picture {
    std::size_t width = 0, height = 0;
    std::vector<std::uint8_t> pixels;

    tf_frame frame() const { return tf::frame(pixels.data(), width, height); }
};

// Reads a PPM file. Yours asks the camera.
Picture read_picture(const std::string &path)
{
    std::ifstream file(path, std::ios::binary);
    std::string magic;
    Picture picture;
    int most = 0;
    file >> magic >> picture.width >> picture.height >> most;
    file.get();
    if (!file || magic != "P6" || most != 255 || picture.width > 10000 || picture.height > 10000) {
        throw std::runtime_error(path + ": expected a PPM file");
    }
    picture.pixels.resize(3 * picture.width * picture.height);
    file.read(reinterpret_cast<char *>(picture.pixels.data()), static_cast<std::streamsize>(picture.pixels.size()));
    if (!file) {
        throw std::runtime_error(path + ": the file is too short");
    }
    return picture;
}

// The robot: it moves, touches and takes a picture. This one plays what was recorded.
Picture touch(const std::string &folder, int n) { return read_picture(folder + "/touch-" + std::to_string(n) + ".ppm"); }

void print_pose(const char *label, const tf_pose &pose)
{
    std::printf("%s %.17g %.17g %.17g\n", label, pose.x_mm, pose.y_mm, pose.theta_rad);
}

void print_move(int n, const tf_pose &move)
{
    std::printf("touch %d after a motion of", n);
    print_pose("", move);
}

void print_done(const tf_decision &done)
{
    static const char *const reasons[] = {"none", "confident", "none of these", "touch limit", "nothing to learn"};
    const tf_estimate &estimate = done.estimate;
    std::printf("stop: %s after %zu touches\n", reasons[done.stop], estimate.n_touches);
    std::printf("part %s probability %.17g\n", std::string(tf::name(estimate)).c_str(), estimate.probability);
    print_pose("pose", estimate.part_from_sensor);
    print_pose("pose", estimate.part_from_first);
    std::printf("covariance");
    for (const double value : estimate.covariance) {
        std::printf(" %.17g", value);
    }
    std::printf("\nfit %.17g entropy %.17g\n", estimate.fit, estimate.entropy_nats);
}

void print_runner_up(const std::optional<tf_runner_up> &other)
{
    if (other) {
        std::printf("runner-up %s probability %.17g\n", std::string(tf::name(*other)).c_str(), other->probability);
    } else {
        std::printf("no runner-up\n");
    }
}

void print_belief(const tf::Bank &bank, const tf::Episode &episode)
{
    const auto names = bank.parts();
    const auto posterior = episode.class_posterior();
    for (std::size_t part = 0; part < names.size(); part++) {
        std::printf("posterior %s %.17g\n", std::string(names[part]).c_str(), posterior[part]);
    }
    for (const tf_mode &mode : episode.modes()) {
        std::printf("mode %s %.17g", std::string(names[mode.part]).c_str(), mode.mass);
        print_pose(" at", mode.part_from_sensor);
    }
}

// On this thread: each call takes some milliseconds.
tf::Episode on_this_thread(const std::string &folder, const tf::Config &config, const tf::Bank &bank,
                           const tf::Sensor &sensor, const std::vector<tf_pose> &reach)
{
    const Picture first = touch(folder, 1);
    tf::Episode episode = tf::Episode::begin(config, bank, sensor.observe(first.frame()));
    for (int n = 2;; n++) {
        const tf_decision decision = episode.decide(reach);
        if (decision.kind == TF_DECISION_KIND_DONE) {
            print_done(decision);
            print_runner_up(episode.runner_up());
            return episode;
        }
        print_move(n, decision.sensor_from_next);
        const Picture picture = touch(folder, n);
        // Give the motion that was really made; the one recorded here is exact.
        episode.observe(decision.sensor_from_next, sensor.observe(picture.frame()));
        // As after a power cut.
        episode = tf::Episode::restore(bank, episode.record());
    }
}

// In a control loop that never waits: submit a touch, go on, poll in each cycle.
void on_a_runner(const std::string &folder, tf::Runner &runner, const std::vector<tf_pose> &reach)
{
    tf_pose moved{};
    for (int n = 1;; n++) {
        const Picture picture = touch(folder, n);
        if (!runner.submit(picture.frame(), moved, reach)) {
            throw std::runtime_error("the queue is full");
        }
        std::optional<tf_outcome> outcome;
        while (!(outcome = runner.poll())) {
            std::this_thread::sleep_for(std::chrono::milliseconds(1));  // Here your loop does its work.
        }
        if (outcome->kind != TF_OUTCOME_KIND_DECISION) {
            throw tf::Error(outcome->status);
        }
        if (outcome->decision.kind == TF_DECISION_KIND_DONE) {
            print_done(outcome->decision);
            print_runner_up(runner.runner_up());
            return;
        }
        moved = outcome->decision.sensor_from_next;
        print_move(n + 1, moved);
    }
}

void run(const std::string &folder)
{
    const tf::Model model = tf::Model::load(folder + "/model.safetensors");
    const tf::Bank bank = tf::Bank::load(model, folder + "/parts.bank");
    const Picture at_rest = read_picture(folder + "/rest.ppm");
    const tf::Sensor sensor = tf::Sensor::create(model, at_rest.frame());
    std::vector<tf_pose> reach;  // motions of up to 8 mm along x and y
    for (int i = 0; i < 81; i++) {
        reach.push_back({2.0 * (i % 9 - 4), 2.0 * (i / 9 - 4), 0.0});
    }
    tf::Config config = model.config();
    config.set("stop_place_mm", 0.3);
    config.set("n_finalists", "none");
    const tf::Episode episode = on_this_thread(folder, config, bank, sensor, reach);
    print_belief(bank, episode);
    tf::Runner runner = tf::Runner::start(sensor, bank, config, 2);
    on_a_runner(folder, runner, reach);
    print_belief(bank, episode);
}

}  // namespace

int main(int argc, char **argv)
{
    if (argc != 2 || !tf::is_compatible()) {
        std::fprintf(stderr, "usage: episode FOLDER, with a library of version %d\n", TF_ABI_VERSION);
        return 2;
    }
    try {
        run(argv[1]);
        return 0;
    } catch (const std::exception &error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return 1;
    }
}
