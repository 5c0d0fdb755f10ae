// SPDX-License-Identifier: Apache-2.0
//
// Frames on the bus of a rig, from its devices or from anything else that is wired to it: a byte with the
// time that passes [ms] and the kind of frame, the identifier as the kernel has it, the length, the bytes.
#include <linux/can/error.h>

#include <cmath>
#include <optional>

#include "common/base/utf8.h"
#include "hw/can/kernel_frame.h"
#include "hw/can/odrive.h"
#include "hw/can/payload.h"
#include "hw/can/strange_frame.h"
#include "hw/can/xsens.h"
#include "hw/rig/rig.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

constexpr std::array kNodes{odrive::Node{16}, odrive::Node{17}};
constexpr size_t kHeadBytes = 6;

/// As shoulder.yaml has it.
constexpr const char* kRig =
    "name: shoulder\nperiod: 10\ndeadlines: {commander: 60, imu: 50, drive: 50}\nimu: {rate: 100}\naxes:\n"
    "  pan: {node: 16, gear: 20, home: -56, position: [-58, 58], margin: 5, rate: 120, acceleration: 500, "
    "coasting: 250, gain: 20, current: 5, neutral: 0, lag: 7, backlash: 0.3}\n"
    "  tilt: {node: 17, gear: -20, home: 36, position: [-40, 40], margin: 5, rate: 120, acceleration: 500, "
    "coasting: 250, gain: 20, current: 5, neutral: 0, lag: 7, backlash: 0.3}\n";

const RigConfiguration& configuration() {
  static const RigConfiguration made = [] {
    const MemoryFile file(bytes_of(kRig));
    auto read = read_rig_configuration(file.path());
    demand(read.has_value(), read ? std::string() : read.error().message);
    return *read;
  }();
  return made;
}

struct TimedFrame {
  std::chrono::milliseconds pause{0};
  KernelFrame frame;
};

std::optional<TimedFrame> take_frame(Bytes* bytes) {
  if (bytes->size() < kHeadBytes) return std::nullopt;
  TimedFrame taken;
  taken.pause = std::chrono::milliseconds((*bytes)[0] & 0x3F);
  taken.frame.size = ((*bytes)[0] & 0x80) != 0 ? CANFD_MTU : CAN_MTU;
  taken.frame.frame.flags = ((*bytes)[0] & 0x40) != 0 ? CANFD_BRS : 0;
  taken.frame.frame.can_id = get_number<uint32_t>(*bytes, 1, std::endian::little);
  taken.frame.frame.len = (*bytes)[5];
  const size_t length = std::min<size_t>({(*bytes)[5], bytes->size() - kHeadBytes, kMaxFdPayload});
  std::copy_n(bytes->begin() + kHeadBytes, length, taken.frame.frame.data);
  *bytes = bytes->subspan(kHeadBytes + length);
  return taken;
}

template <typename Decoded, typename Again>
void demand_same(const Decoded& decoded, const Again& decode_again) {
  if (decoded) demand(decode_again(*decoded), "a message that is read is written and read back");
}

void read_messages(const CanFrame& frame) {
  demand(!fault_of_text(describe_strange(frame, kNodes)), "why a frame is strange can be shown");
  static_cast<void>(to_string(frame));
  demand_same(odrive::decode(frame, kNodes), [](const odrive::Addressed& read) {
    const auto written = odrive::encode(read.node, read.message);
    return written && odrive::decode(*written, kNodes) == read;
  });
  demand_same(xsens::decode(frame), [](const xsens::Message& read) {
    const auto written = xsens::encode(read);
    return written && xsens::decode(*written).has_value();
  });
}

void demand_sound(const Rig& rig) {
  if (const auto angles = rig.angles())
    demand(std::isfinite(angles->pan) && std::isfinite(angles->tilt), "angles are finite");
  demand(!fault_of_text(rig.describe()) && !fault_of_text(rig.describe_strange()), "its words can be shown");
}

/// `pause` [ms], as take_frame() reads it.
void put(const CanFrame& frame, uint8_t pause, Input* out) {
  const KernelFrame kernel = to_kernel(frame);
  out->push_back(static_cast<uint8_t>(pause | (frame.fd ? 0x80 : 0)));
  const size_t at = out->size();
  out->resize(at + sizeof(uint32_t));
  put_number(kernel.frame.can_id, std::span(*out), at, std::endian::little);
  out->push_back(kernel.frame.len);
  out->insert(out->end(), kernel.frame.data, kernel.frame.data + frame.payload().size());
}

template <typename Message>
void put_of_drive(uint8_t node, const Message& message, uint8_t pause, Input* out) {
  const auto frame = odrive::encode({node}, message);
  demand(frame.has_value(), "a drive's message can be written");
  put(*frame, pause, out);
}

void put_of_imu(const xsens::Message& message, Input* out) {
  const auto frame = xsens::encode(message);
  demand(frame.has_value(), "the IMU's message can be written");
  put(*frame, 0, out);
}

}  // namespace

void decode(Bytes bytes) {
  MonotonicTime now{std::chrono::hours(1)};
  Rig rig(configuration(), now);
  static_cast<void>(rig.take({"ann", rig_command::Home{}}, now));
  while (const auto next = take_frame(&bytes)) {
    now += next->pause;
    const auto read = from_kernel(next->frame);
    if (const auto* errors = std::get_if<BusErrors>(&read))
      demand(!fault_of_text(describe(*errors)), "what a bus reports can be shown");
    if (const auto* frame = std::get_if<CanFrame>(&read)) {
      read_messages(*frame);
      rig.receive(*frame, now);
    }
    static_cast<void>(rig.take({"ann", rig_command::Activate{}}, now));
    rig.advance(now);
    demand_sound(rig);
    for (const OutgoingFrame& out : rig.take_frames())
      demand(is_valid(out.frame), "what the rig sends can be sent");
  }
}

std::vector<Input> seeds() {
  Input quiet;
  for (uint8_t step = 0; step < 8; ++step) {
    for (const uint8_t node : {uint8_t{16}, uint8_t{17}}) {
      put_of_drive(node, odrive::Heartbeat{0, odrive::AxisState::kClosedLoop, 0, true}, 0, &quiet);
      put_of_drive(node, odrive::EncoderEstimates{0.1F * static_cast<float>(step), 0.5F}, 0, &quiet);
    }
    put_of_imu(xsens::SampleTime{100U * step}, &quiet);
    put_of_imu(xsens::GroupCounter{step}, &quiet);
    put_of_imu(xsens::RateOfTurn{{0.1, -0.2, 0.3}}, &quiet);
    put_of_imu(xsens::Acceleration{{0, 0, 9.8}}, &quiet);
    put_of_drive(16, odrive::Errors{}, 10, &quiet);
  }
  Input others;
  put_of_drive(16, odrive::Estop{}, 1, &others);
  put_of_drive(17, odrive::SetInputPosition{1, 0.5F, 0}, 1, &others);
  put_of_drive(40, odrive::SetLimits{3, 5}, 1, &others);
  put_of_drive(17, odrive::Request::kErrors, 1, &others);
  put_of_imu(xsens::Quaternion{0.1, 0.2, 0.3, 0.9}, &others);
  put_of_imu(xsens::Euler{0.1, 0.2, 0.3}, &others);
  put_of_imu(xsens::StatusWord{3}, &others);
  put({.id = {CAN_ERR_FLAG | CAN_ERR_CRTL | CAN_ERR_BUSOFF, false},
       .length = 8,
       .data = {0, 4, 0, 0, 0, 0, 96, 7}},
      1, &others);
  put({.id = {0x1234567, true}, .fd = true, .fast_data = true, .length = 64, .data = {1, 2, 3}}, 5, &others);
  return {quiet, others};
}

}  // namespace cairn::fuzz
