// SPDX-License-Identifier: Apache-2.0
#include "server/admin/rig_commands.h"

#include <chrono>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>
#include <vector>

#include "common/base/log.h"
#include "common/io/json_text.h"
#include "common/map/ids.h"
#include "server/admin/interruption.h"

namespace cairn {
namespace {

using nlohmann::json;
using wire::RigMode;
using wire::RigState;

constexpr double kDegree = std::numbers::pi / 180;

constexpr const char* kFooter =
    "The rig is asked without a server between. Who commands it says so as long as that is to last: `mode` "
    "holds\n"
    "it until it is interrupted, which lets the drives go.\n\n"
    "Examples:\n"
    "  cairnctl rig shoulder stop                emergency stop, whoever commands it\n"
    "  cairnctl rig shoulder clear               forgets stop and faults; nothing moves\n"
    "  cairnctl rig shoulder mode home\n"
    "  cairnctl rig shoulder mode neutral --for 10\n"
    "  cairnctl rig shoulder mode saccade --angles 20 -5\n"
    "  cairnctl rig shoulder mode search --pattern raster\n"
    "  cairnctl rig shoulder state --at wearable-3";

struct Words {
  std::string rig;
  std::string host = "localhost";
  std::string mode;
  std::vector<double> angles{0, 0};  ///< [deg]
  std::vector<double> rates{0, 0};   ///< [deg/s]
  std::vector<double> direction{0, 0, 0};
  std::string pattern = "spiral";
  double seconds = 0;  ///< 0: until it is interrupted
};

const char* words_of(wire::RigAxisCondition condition) {
  using wire::RigAxisCondition;
  switch (condition) {
    case RigAxisCondition::kUnknown:
      return "not homed";
    case RigAxisCondition::kHoming:
      return "homing";
    case RigAxisCondition::kIdle:
      return "idle";
    case RigAxisCondition::kActivating:
      return "activating";
    case RigAxisCondition::kActive:
      return "active";
    case RigAxisCondition::kClearing:
      return "clearing";
    case RigAxisCondition::kFaulted:
      return "fault";
    case RigAxisCondition::kStopped:
      return "stopped";
  }
  return "";
}

json describe(const RigState& state) {
  json axes = json::object();
  for (size_t i = 0; i < state.axes.size(); ++i) {
    const wire::RigAxisState& axis = state.axes.at(i);
    axes[i == 0 ? "pan" : "tilt"] = {
        {"state", words_of(axis.condition)},
        {"fault", axis.fault},
        {"position_deg", axis.position_known ? json(axis.position / kDegree) : json()},
        {"rate_deg_s", axis.rate / kDegree}};
  }
  json all = {{"rig", state.rig},
              {"mode", std::string(wire::name_of(state.mode))},
              {"commander", state.commander},
              {"stopped", state.stopped},
              {"drives_idle", state.drives_idle},
              {"axes", axes},
              {"trouble", state.trouble}};
  if (state.has_imu) {
    const wire::RigImu& imu = state.imu;
    all["imu"] = {{"rate_rad_s", {imu.rate.x(), imu.rate.y(), imu.rate.z()}},
                  {"acceleration_m_s2", {imu.acceleration.x(), imu.acceleration.y(), imu.acceleration.z()}},
                  {"clock_offset_s", static_cast<double>(imu.clock_offset) * 1e-9}};
  }
  if (state.camera_clock.known) {
    all["camera_clock"] = {{"offset_s", static_cast<double>(state.camera_clock.offset) * 1e-9},
                           {"sigma_s", state.camera_clock.sigma}};
  }
  return all;
}

void print_state(const RigState& state, bool as_json) {
  if (as_json) {
    std::printf("%s\n", json_text(describe(state), 2).c_str());
    return;
  }
  std::printf("mode     %s%s%s\n", std::string(wire::name_of(state.mode)).c_str(),
              state.commander.empty() ? "" : ", last commanded by ", state.commander.c_str());
  for (size_t i = 0; i < state.axes.size(); ++i) {
    const wire::RigAxisState& axis = state.axes.at(i);
    std::printf("%s %s", i == 0 ? "pan     " : "tilt    ", words_of(axis.condition));
    if (axis.position_known)
      std::printf(", at %.2f deg, %.1f deg/s", axis.position / kDegree, axis.rate / kDegree);
    std::printf("\n");
  }
  if (state.has_imu) {
    std::printf("IMU      turns at %.3f rad/s, pulled by %.2f m/s^2\n",
                static_cast<double>(state.imu.rate.norm()),
                static_cast<double>(state.imu.acceleration.norm()));
  }
  if (state.camera_clock.known) {
    std::printf("camera   its stamps lack %.1f ms to the IMU's, known to %.1f ms\n",
                static_cast<double>(state.camera_clock.offset) * 1e-6,
                static_cast<double>(state.camera_clock.sigma) * 1000);
  }
  std::printf("trouble  %s\n", state.trouble.empty() ? "none" : state.trouble.c_str());
}

/// Waits after the drives were told to move: until they no longer do, the time is over, or it is interrupted.
/// Drives that move then are told to be idle.
Status hold(RigClient* client, RigMode mode, const Words& words) {
  const Interruption interruption;
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(words.seconds);
  const auto asked = [&] {
    return Interruption::requested() || (words.seconds > 0 && std::chrono::steady_clock::now() >= end);
  };
  // Homing ends by itself; all other modes are what the rig is to be in.
  const auto last = client->hold([](const RigState& state) { return state.drives_idle; }, asked);
  if (!last) return tl::unexpected(last.error());
  if (!last->drives_idle) {
    wire::RigCommand idle;
    idle.mode = RigMode::kIdle;
    if (const auto done = client->give(idle); !done) return tl::unexpected(done.error());
  }
  if (Interruption::requested()) return fail(ErrorCode::kIo, "interrupted; the drives are let go");
  if (!last->drives_idle) return {};
  if (mode == RigMode::kHome && last->trouble.empty() && !last->stopped) return {};
  return fail(ErrorCode::kRefused,
              "the rig has let its drives go: " + (last->trouble.empty() ? "it was told to" : last->trouble));
}

Status order(const RigClientOptions& network, bool as_json, RigMode mode, const Words& words) {
  auto client = RigClient::join(network);
  if (!client) return tl::unexpected(client.error());
  wire::RigCommand command;
  command.mode = mode;
  for (size_t i = 0; i < 2; ++i) {
    command.angles.at(i) = words.angles.at(i) * kDegree;
    command.rates.at(i) = words.rates.at(i) * kDegree;
  }
  command.target = Eigen::Vector3d(words.direction.data());
  command.pattern = wire::parse_rig_search(words.pattern).value_or(wire::RigSearchPattern::kSpiral);
  const auto done = client->give(command);
  if (!done) return tl::unexpected(done.error());
  if (done->drives_idle) {
    print_state(*done, as_json);
    return {};
  }
  if (Status held = hold(&*client, mode, words); !held) return held;
  const auto state = client->state();
  if (!state) return tl::unexpected(state.error());
  print_state(*state, as_json);
  return {};
}

/// Clears an emergency stop, then faults: each is a command of its own, and nothing moves.
Status clear(const RigClientOptions& network, bool as_json) {
  auto client = RigClient::join(network);
  if (!client) return tl::unexpected(client.error());
  for (const RigMode mode : {RigMode::kClearStop, RigMode::kClear}) {
    wire::RigCommand command;
    command.mode = mode;
    if (const auto done = client->give(command); !done) return tl::unexpected(done.error());
  }
  const auto is_cleared = [](const RigState& state) {
    return state.axes[0].condition != wire::RigAxisCondition::kClearing &&
           state.axes[1].condition != wire::RigAxisCondition::kClearing;
  };
  const auto state = client->hold(is_cleared, [] { return false; });
  if (!state) return tl::unexpected(state.error());
  print_state(*state, as_json);
  // Why the drives were let go before is still told; it is over.
  const bool is_clear = !state->stopped && state->axes[0].fault == 0 && state->axes[1].fault == 0;
  return is_clear ? Status() : fail(ErrorCode::kRefused, state->trouble);
}

std::string check_mode(const std::string& word) {
  const auto mode = wire::parse_rig_mode(word);
  const bool fits = mode && *mode <= RigMode::kJog;
  return fits ? ""
              : "'" + word +
                    "' is no mode; there are idle, home, neutral, follow, lock, fixate, saccade, search, jog";
}

std::string check_rig(const std::string& name) {
  return is_valid_name(name) ? "" : "'" + name + "' is not the name of a rig: 1 to 32 of a-z, 0-9 and -";
}

}  // namespace

void describe_rig(CLI::App* app, RigAction* action) {
  const auto words = std::make_shared<Words>();
  CLI::App* rig = app->add_subcommand("rig", "a rig: a camera that cairn-rig moves");
  rig->footer(kFooter);
  rig->add_option("RIG", words->rig, "its name")->required()->check(check_rig);
  rig->add_option("--at", words->host, "host of cairn-rig")->capture_default_str();
  rig->require_subcommand(1);
  const auto does = [action, words](std::function<Status(const RigClientOptions&, bool)> what) {
    return [action, words, what = std::move(what)] {
      *action = [words, what](RigClientOptions network, bool as_json) {
        network.rig = words->rig;
        network.host = words->host;
        return what(network, as_json);
      };
    };
  };
  rig->add_subcommand("state", "what it does, where its axes stand, what keeps it from moving")
      ->callback(does([](const RigClientOptions& network, bool as_json) -> Status {
        auto client = RigClient::join(network);
        if (!client) return tl::unexpected(client.error());
        const auto state = client->state();
        if (!state) return tl::unexpected(state.error());
        print_state(*state, as_json);
        return {};
      }));
  rig->add_subcommand("stop", "emergency stop: at once, until it is cleared")
      ->callback(does([words](const RigClientOptions& network, bool as_json) {
        return order(network, as_json, RigMode::kStop, *words);
      }));
  rig->add_subcommand("clear", "forgets an emergency stop and faults")->callback(does(clear));
  CLI::App* mode = rig->add_subcommand("mode", "has the rig do so until it is interrupted");
  mode->add_option("MODE", words->mode, "idle, home, neutral, follow, lock, fixate, saccade, search or jog")
      ->required()
      ->check(check_mode);
  mode->add_option("--for", words->seconds, "seconds [until it is interrupted]")->check(CLI::PositiveNumber);
  mode->add_option("--angles", words->angles, "saccade: pan and tilt [deg]")->expected(2);
  mode->add_option("--rates", words->rates, "jog: of pan and tilt [deg/s]")->expected(2);
  mode->add_option("--direction", words->direction,
                   "lock, search: of the world, z up [where the camera looks at that moment]")
      ->expected(3);
  mode->add_option("--pattern", words->pattern, "search: spiral around where it begins, or raster, in rows")
      ->check(CLI::IsMember({"spiral", "raster"}))
      ->capture_default_str();
  mode->callback(does([words](const RigClientOptions& network, bool as_json) {
    return order(network, as_json, wire::parse_rig_mode(words->mode).value_or(RigMode::kIdle), *words);
  }));
}

}  // namespace cairn
