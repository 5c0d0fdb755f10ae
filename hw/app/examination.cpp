// SPDX-License-Identifier: Apache-2.0
#include "hw/app/examination.h"

#include <fmt/format.h>
#include <linux/can/netlink.h>

#include <cmath>

#include "hw/can/strange_frame.h"

namespace cairn {
namespace {

constexpr double kLeastHeartbeats = 5;    // [1/s] of 10
constexpr double kMostLoad = 0.7;         // of a bus whose frames are to come in time
constexpr uint64_t kBitsAroundData = 60;  // of a frame with identifier of 11 bits, with some stuffing
constexpr double kRateTolerance = 0.1;

constexpr std::array<odrive::Node, odrive::kMaxNode + 1> all_nodes() {
  std::array<odrive::Node, odrive::kMaxNode + 1> nodes{};
  for (uint8_t i = 0; i <= odrive::kMaxNode; ++i) nodes.at(i) = {i};
  return nodes;
}

/// A message that a rig needs of each sample of the IMU.
struct NeededMessage {
  xsens::Message message;
  const char* name;
};
const std::array<NeededMessage, 4> kNeeded = {{{xsens::SampleTime{}, "SampleTime"},
                                               {xsens::GroupCounter{}, "GroupCounter"},
                                               {xsens::RateOfTurn{}, "RateOfTurn"},
                                               {xsens::Acceleration{}, "Acceleration"}}};

constexpr auto kAllNodes = all_nodes();

Check passed(std::string what) {
  return {true, std::move(what)};
}
Check failed(std::string what) {
  return {false, std::move(what)};
}

Check check_bit_rate(const std::string& name, const InterfaceFacts& facts) {
  if (facts.kind != "can") return passed("bit rate: a virtual bus has none");
  if (facts.bit_rate.value_or(0) == 0) {
    return failed("bit rate: not set; `sudo ip link set " + name +
                  " up type can bitrate 500000 restart-ms 100`");
  }
  const std::string rate = fmt::format("bit rate: {} kbit/s", *facts.bit_rate / 1000);
  if (facts.restart_ms.value_or(0) > 0) return passed(rate + ", and it comes back from bus-off by itself");
  return passed(rate + "; after bus-off it stays away: restart-ms 100 beside the bit rate brings it back");
}

Check check_controller(const std::string& name, const InterfaceFacts& facts) {
  if (!facts.state) return passed("bus errors: a virtual bus has none");
  const std::string counters =
      fmt::format("transmit errors {}, receive errors {}", facts.transmit_errors.value_or(0),
                  facts.receive_errors.value_or(0));
  if (*facts.state == CAN_STATE_ERROR_ACTIVE) return passed("bus errors: few (" + counters + ")");
  if (*facts.state == CAN_STATE_BUS_OFF) {
    return failed("bus errors: the controller is bus-off (" + counters +
                  "); check wiring, termination and bit rate, then `sudo ip link set " + name +
                  " type can restart`");
  }
  return failed(
      "bus errors: many (" + counters +
      "); is another node powered, at the same bit rate, and is the cable terminated with 120 ohms at "
      "both ends?");
}

}  // namespace

std::vector<Check> check_interface(const std::string& name, const Result<InterfaceFacts>& facts) {
  if (!facts) return {failed("interface: " + facts.error().message)};
  if (!facts->is_can)
    return {failed("interface: " + name + " is no CAN interface; `ip -br link show type can` lists those")};
  std::vector<Check> checks = {
      passed("interface: " + name + " is there" + (facts->kind.empty() ? "" : ", of kind " + facts->kind))};
  if (facts->is_up) {
    checks.push_back(passed("interface: up"));
  } else {
    checks.push_back(failed("interface: down; `sudo ip link set " + name + " up" +
                            (facts->kind == "can" ? " type can bitrate 500000 restart-ms 100`" : "`")));
  }
  checks.push_back(check_bit_rate(name, *facts));
  checks.push_back(check_controller(name, *facts));
  return checks;
}

void Examination::receive(const CanFrame& frame) {
  bits_ += kBitsAroundData + uint64_t{8} * frame.length;
  if (const auto from_imu = xsens::decode(frame)) {
    ++imu_.at(from_imu->index());
    return;
  }
  const auto from_drive = odrive::decode(frame, kAllNodes);
  if (!from_drive) {
    ++strange_frames_;
    strange_ = frame;
    return;
  }
  if (const auto* heartbeat = std::get_if<odrive::Heartbeat>(&from_drive->message)) {
    Drive& drive = drives_[from_drive->node];
    ++drive.heartbeats;
    drive.errors = heartbeat->axis_error;
  } else if (std::holds_alternative<odrive::EncoderEstimates>(from_drive->message)) {
    ++drives_[from_drive->node].estimates;
  }
}

/// The drives that were heard and that no axis has, "; heard are drives of other node numbers: 18, 19";
/// empty: none.
std::string Examination::other_nodes() const {
  std::string list;
  for (const auto& [node, drive] : drives_) {
    if (node == configuration_.axes[0].node || node == configuration_.axes[1].node) continue;
    list += (list.empty() ? "" : ", ") + std::to_string(node.value);
  }
  return list.empty() ? "" : "; heard are drives of other node numbers: " + list;
}

void Examination::check_drive(AxisName name, double listened, std::vector<Check>* checks) const {
  const odrive::Node node = configuration_.axis(name).node;
  const std::string who = fmt::format("{} (node {})", to_string(name), node.value);
  const auto found = drives_.find(node);
  const Drive drive = found == drives_.end() ? Drive{} : found->second;
  if (drive.heartbeats < kLeastHeartbeats * listened) {
    checks->push_back(failed(fmt::format(
        "{}: {} heartbeats, 10 a second are expected; check its supply, its plug, the bit rate, and in the "
        "drive node_id and heartbeat_msg_rate_ms (100){}",
        who, drive.heartbeats == 0 ? "no" : "too few", other_nodes())));
    if (drive.heartbeats == 0) return;
  } else {
    checks->push_back(passed(who + ": it answers"));
  }
  const double most = std::chrono::duration<double>(configuration_.drive_deadline).count();
  if (drive.estimates * most < listened) {
    checks->push_back(
        failed(fmt::format("{}: its encoder is told {:.0f} times a second, 100 are expected; set "
                           "encoder_msg_rate_ms in the drive to 10",
                           who, drive.estimates / listened)));
  } else {
    checks->push_back(passed(
        fmt::format("{}: its encoder is told {:.0f} times a second", who, drive.estimates / listened)));
  }
  if (drive.errors == 0) {
    checks->push_back(passed(who + ": no errors"));
  } else {
    checks->push_back(
        failed(fmt::format("{}: errors 0x{:08X}; look the bits up in the drive's manual (0x01000000: "
                           "its watchdog, 0x02000000: emergency stop), then clear them: "
                           "`cairnctl rig {} clear`",
                           who, drive.errors, configuration_.name)));
  }
}

void Examination::check_strange(std::vector<Check>* checks) const {
  if (!strange_) return;
  checks->push_back(failed(fmt::format("{}; {} frames are no messages of a drive or of the IMU",
                                       describe_strange(*strange_, kAllNodes), strange_frames_)));
}

void Examination::check_imu(double listened, std::vector<Check>* checks) const {
  if (!configuration_.imu) {
    checks->push_back(passed("IMU: the rig has none"));
    return;
  }
  std::string missing;
  for (const NeededMessage& needed : kNeeded) {
    if (imu_.at(needed.message.index()) == 0)
      missing += (missing.empty() ? "" : ", ") + std::string(needed.name);
  }
  const int samples = imu_.at(xsens::Message(xsens::SampleTime{}).index());
  if (!missing.empty()) {
    checks->push_back(
        failed("IMU: no " + missing + "; " +
               (samples == 0 ? "check its supply, its plug, the bit rate (250 kbit/s as delivered) and the "
                               "identifiers of its messages"
                             : "switch these messages on in the device")));
    return;
  }
  const double rate = samples / listened;
  const double wanted = configuration_.imu->rate;
  if (std::abs(rate - wanted) > kRateTolerance * wanted) {
    checks->push_back(failed(fmt::format(
        "IMU: {:.0f} samples a second, `imu: rate:` says {:.0f}; change one of them", rate, wanted)));
  } else {
    checks->push_back(passed(fmt::format("IMU: {:.0f} samples a second", rate)));
  }
}

std::vector<Check> Examination::conclude(std::chrono::duration<double> listened,
                                         std::optional<uint32_t> bit_rate) const {
  std::vector<Check> checks;
  for (const AxisName name : kAxisNames) check_drive(name, listened.count(), &checks);
  check_imu(listened.count(), &checks);
  check_strange(&checks);
  if (bit_rate.value_or(0) > 0) {
    const double load = static_cast<double>(bits_) / listened.count() / *bit_rate;
    checks.push_back({load <= kMostLoad, fmt::format("load of the bus: {:.0f} %{}", load * 100,
                                                     load <= kMostLoad ? ""
                                                                       : "; raise the bit rate of all nodes, "
                                                                         "or have fewer messages sent")});
  }
  return checks;
}

}  // namespace cairn
