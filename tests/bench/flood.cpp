// SPDX-License-Identifier: Apache-2.0
// cairn-flood: a client that sends many times what a tracker sends, as soon as there is a map, and counts
// what it is answered. What it sends is well-formed, so that each piece costs its receiver what a real one
// would.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <utility>

#include "client/session/image_encoder.h"
#include "common/base/result.h"
#include "common/image/image.h"
#include "common/wire/log_redirect.h"
#include "common/wire/participant.h"
#include "common/wire/partition.h"
#include "common/wire/topic.h"

namespace cairn {
namespace {

using Clock = std::chrono::steady_clock;

struct FloodOptions {
  int domain = 0;
  std::string name = "flood";
  double times = 100;
  int seconds = 30;
};

// What a tracker sends, per second.
constexpr double kStates = 30;
constexpr double kKeyframes = 1;
constexpr double kQueries = 2;
constexpr double kRequests = 0.1;
constexpr double kSeeds = 0.1;

/// Smooth noise: as large as an image once it is encoded, and of no place.
GrayImage noise_image(int width, int height, unsigned seed) {
  cv::RNG random(seed);
  cv::Mat noise(height / 4, width / 4, CV_8U);
  random.fill(noise, cv::RNG::UNIFORM, 0, 256);
  cv::Mat smooth;
  cv::resize(noise, smooth, {width, height}, 0, 0, cv::INTER_CUBIC);
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) std::copy_n(smooth.ptr<uint8_t>(y), width, image.row(y));
  return image;
}

class Flood {
 public:
  Flood(const FloodOptions& options, wire::Participant participant)
      : options_(options),
        participant_(std::move(participant)),
        partition_(wire::client_partition(options.name)),
        id_(client_id_from_name(options.name)) {}

  Status run() {
    auto writers =
        wire::create_all<wire::Writer<wire::CameraMessage>, wire::Writer<wire::TrackerStateMessage>,
                         wire::Writer<wire::KeyframeOffer>, wire::Writer<wire::RelocQuery>,
                         wire::Writer<wire::ClientRequest>, wire::Writer<wire::MapSeed>>(participant_,
                                                                                         partition_);
    if (!writers) return tl::unexpected(writers.error());
    auto readers = wire::create_all<wire::Reader<wire::ServerStatus>, wire::Reader<wire::MapInfo>,
                                    wire::Reader<wire::OfferVerdict>, wire::Reader<wire::RelocAnswer>>(
        participant_, partition_);
    if (!readers) return tl::unexpected(readers.error());
    auto& [cameras, states, offers, queries, requests, seeds] = *writers;
    auto& [status, maps, verdicts, answers] = *readers;
    prepare();
    const auto patience = Clock::now() + std::chrono::minutes(2);
    while (!map_) {
      if (Clock::now() > patience) return fail(ErrorCode::kNoServer, "no map was heard of in two minutes");
      if (Status said = cameras.write(camera_); !said) return said;
      if (Status said = states.write(state_); !said) return said;
      (void)status.take();
      for (const auto& sample : maps.take()) {
        if (sample.message) map_ = sample.message;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    aim_at_map();
    std::fprintf(stderr, "cairn-flood: begins\n");
    const auto begun = Clock::now();
    const auto end = begun + std::chrono::seconds(options_.seconds);
    while (Clock::now() < end) {
      const double now = std::chrono::duration<double>(Clock::now() - begun).count();
      send(states, &state_, "states", kStates, now);
      send(offers, &offer_, "keyframes", kKeyframes, now);
      send(queries, &query_, "queries", kQueries, now);
      send(requests, &request_, "requests", kRequests, now);
      send(seeds, &seed_, "seeds", kSeeds, now);
      (void)status.take();
      (void)maps.take();
      for (const auto& sample : verdicts.take()) {
        if (!sample.message) continue;
        for (const wire::OfferOutcome& outcome : sample.message->recent) hear("keyframes", outcome.reason);
      }
      for (const auto& sample : answers.take()) {
        if (sample.message) hear("queries", sample.message->answer.reason);
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    std::printf("%s\n", nlohmann::json{{"sent", sent_}, {"heard", heard_}}.dump().c_str());
    return {};
  }

 private:
  void prepare() {
    camera_.client = id_;
    camera_.parameters = {CameraModel::kPinholeRadtan, 640, 480, {500, 500, 319.5, 239.5}};
    state_.client = id_;
    state_.session = session_;
    const GrayImage image = noise_image(640, 480, 1);
    offer_.client = id_;
    offer_.image = encode_image(image, wire::ImageEncoding::kJpeg);
    std::mt19937 random(7);
    query_.client = id_;
    query_.small_image = encode_image(noise_image(80, 60, 2), wire::ImageEncoding::kRaw);
    for (int i = 0; i < 700; ++i) {
      PlaceCorner corner;
      corner.pixel = {static_cast<float>(random() % 640), static_cast<float>(random() % 480)};
      for (auto& word : corner.descriptor) word = static_cast<std::decay_t<decltype(word)>>(random());
      query_.corners.push_back(corner);
    }
    request_.client = id_;
    request_.text = "flood";
    seed_.client = id_;
    seed_.first_image = encode_image(image, wire::ImageEncoding::kJpeg);
    seed_.second_image = encode_image(noise_image(640, 480, 3), wire::ImageEncoding::kJpeg);
    for (uint32_t i = 0; i < 300; ++i) {
      Trail trail;
      trail.id = TrailId{i + 1};
      trail.first = {static_cast<float>(random() % 640), static_cast<float>(random() % 480)};
      trail.second = {static_cast<float>(random() % 640), static_cast<float>(random() % 480)};
      seed_.trails.push_back(trail);
    }
    seed_.second_from_first = SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(1, 0, 0));
  }
  void aim_at_map() {
    state_.map = map_->map;
    offer_.map = map_->map;
    offer_.epoch = map_->epoch;
    offer_.revision = map_->revision;
    offer_.reference = KeyframeId{1};
    request_.map = map_->map;
    request_.epoch = map_->epoch;
    request_.reference = KeyframeId{1};
  }
  template <typename Message>
  void send(wire::Writer<Message>& writer, Message* message, const std::string& kind, double rate,
            double now) {
    uint64_t& sent = sent_[kind];
    const auto due = static_cast<uint64_t>(rate * options_.times * now);
    for (; sent < due; ++sent) {
      if constexpr (requires { message->command; }) message->command = {session_, sent + 1};
      (void)writer.write(*message);
    }
  }
  /// Counts an answer of a kind by its reason, whatever the numbers in it.
  void hear(const std::string& kind, const std::string& reason) {
    std::string words;
    for (const char c : reason) {
      const bool is_digit = c >= '0' && c <= '9';
      if (!is_digit || !words.ends_with('N')) words += is_digit ? 'N' : c;
    }
    ++heard_[kind][words.empty() ? "taken" : words];
  }

  const FloodOptions options_;
  wire::Participant participant_;
  const std::string partition_;
  const ClientId id_;
  const SessionId session_{4242};
  std::optional<wire::MapInfo> map_;
  wire::CameraMessage camera_;
  wire::TrackerStateMessage state_;
  wire::KeyframeOffer offer_;
  wire::RelocQuery query_;
  wire::ClientRequest request_;
  wire::MapSeed seed_;
  std::map<std::string, uint64_t> sent_;
  std::map<std::string, std::map<std::string, uint64_t>> heard_;
};

Status flood(const FloodOptions& options) {
  wire::ParticipantOptions joining;
  joining.domain = static_cast<uint32_t>(options.domain);
  auto participant = wire::Participant::create(joining);
  if (!participant) return tl::unexpected(participant.error());
  return Flood(options, *std::move(participant)).run();
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("Sends a server on this host many times what a tracker sends.");
  cairn::FloodOptions options;
  app.add_option("--domain", options.domain, "DDS domain")->check(CLI::Range(0, 230));
  app.add_option("--name", options.name, "client name");
  app.add_option("--times", options.times, "as much as a tracker sends")->check(CLI::PositiveNumber);
  app.add_option("--seconds", options.seconds, "how long, from when there is a map")
      ->check(CLI::Range(1, 3600));
  CLI11_PARSE(app, argc, argv);
  const cairn::wire::LogRedirect quiet(cairn::null_logger());
  if (const cairn::Status done = cairn::flood(options); !done) {
    std::fprintf(stderr, "cairn-flood: %s\n", done.error().message.c_str());
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
