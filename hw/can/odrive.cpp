// SPDX-License-Identifier: Apache-2.0
#include "hw/can/odrive.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "hw/can/payload.h"

namespace cairn::odrive {
namespace {

constexpr auto kOrder = std::endian::little;
constexpr unsigned kCommandBits = 5;
constexpr uint32_t kCommandMask = (1U << kCommandBits) - 1;
constexpr double kFeedforwardStep = 0.001;

enum class Command : uint8_t {
  kHeartbeat = 0x01,
  kEstop = 0x02,
  kGetError = 0x03,
  kSetAxisState = 0x07,
  kGetEncoderEstimates = 0x09,
  kSetControllerMode = 0x0B,
  kSetInputPosition = 0x0C,
  kSetLimits = 0x0F,
  kClearErrors = 0x18,
};

/// Length [bytes] of a command's payload; nothing for a command that is not of the rig.
std::optional<uint8_t> length_of(Command command) {
  switch (command) {
    case Command::kEstop:
      return 0;
    case Command::kClearErrors:
      return 1;
    case Command::kSetAxisState:
      return 4;
    case Command::kHeartbeat:
    case Command::kGetError:
    case Command::kGetEncoderEstimates:
    case Command::kSetControllerMode:
    case Command::kSetInputPosition:
    case Command::kSetLimits:
      return 8;
  }
  return std::nullopt;
}

/// Fills in the payload of one frame; `ok` is false once a number did not fit.
struct Writer {
  CanFrame frame;
  bool ok = true;

  void begin(Node node, Command command) {
    frame.id.value = uint32_t{node.value} << kCommandBits | static_cast<uint32_t>(command);
    frame.length = *length_of(command);
  }
  template <typename T>
  void put(T value, size_t offset) {
    put_number(value, std::span(frame.data), offset, kOrder);
  }
  void put_float(float value, size_t offset) {
    ok = ok && std::isfinite(value);
    put(value, offset);
  }
  void put_feedforward(float value, size_t offset) {
    const double steps = std::round(static_cast<double>(value) / kFeedforwardStep);
    using Steps = std::numeric_limits<int16_t>;
    const bool fits = steps >= Steps::min() && steps <= Steps::max();  // false for NaN
    ok = ok && fits;
    put(fits ? static_cast<int16_t>(steps) : int16_t{0}, offset);
  }
};

struct Encoder {
  Node node;
  Writer to;

  void operator()(const Heartbeat& m) {
    to.begin(node, Command::kHeartbeat);
    to.put(m.axis_error, 0);
    to.ok = static_cast<uint32_t>(m.state) <= std::numeric_limits<uint8_t>::max();
    to.put(static_cast<uint8_t>(m.state), 4);
    to.put(m.procedure_result, 5);
    to.put(static_cast<uint8_t>(m.trajectory_done ? 1 : 0), 6);
  }
  void operator()(const Errors& m) {
    to.begin(node, Command::kGetError);
    to.put(m.active_errors, 0);
    to.put(m.disarm_reason, 4);
  }
  void operator()(const EncoderEstimates& m) {
    to.begin(node, Command::kGetEncoderEstimates);
    to.put_float(m.position, 0);
    to.put_float(m.velocity, 4);
  }
  void operator()(const Estop&) { to.begin(node, Command::kEstop); }
  void operator()(const SetAxisState& m) {
    to.begin(node, Command::kSetAxisState);
    to.put(static_cast<uint32_t>(m.state), 0);
  }
  void operator()(const SetControllerMode& m) {
    to.begin(node, Command::kSetControllerMode);
    to.put(static_cast<uint32_t>(m.control), 0);
    to.put(static_cast<uint32_t>(m.input), 4);
  }
  void operator()(const SetInputPosition& m) {
    to.begin(node, Command::kSetInputPosition);
    to.put_float(m.position, 0);
    to.put_feedforward(m.velocity_feedforward, 4);
    to.put_feedforward(m.torque_feedforward, 6);
  }
  void operator()(const SetLimits& m) {
    to.begin(node, Command::kSetLimits);
    to.put_float(m.velocity, 0);
    to.put_float(m.current, 4);
  }
  void operator()(const ClearErrors& m) {
    to.begin(node, Command::kClearErrors);
    to.put(static_cast<uint8_t>(m.identify ? 1 : 0), 0);
  }
  void operator()(Request request) {
    to.begin(node, request == Request::kErrors ? Command::kGetError : Command::kGetEncoderEstimates);
    to.frame.remote = true;
  }
};

template <typename T>
T at(const CanFrame& frame, size_t offset) {
  return get_number<T>(frame.payload(), offset, kOrder);
}

float feedforward_at(const CanFrame& frame, size_t offset) {
  return static_cast<float>(at<int16_t>(frame, offset) * kFeedforwardStep);
}

/// The message in a frame that has the command's length.
Message message_of(Command command, const CanFrame& frame) {
  switch (command) {
    case Command::kHeartbeat:
      return Heartbeat{at<uint32_t>(frame, 0), static_cast<AxisState>(at<uint8_t>(frame, 4)),
                       at<uint8_t>(frame, 5), (at<uint8_t>(frame, 6) & 1U) != 0};
    case Command::kGetError:
      return Errors{at<uint32_t>(frame, 0), at<uint32_t>(frame, 4)};
    case Command::kGetEncoderEstimates:
      return EncoderEstimates{at<float>(frame, 0), at<float>(frame, 4)};
    case Command::kSetAxisState:
      return SetAxisState{static_cast<AxisState>(at<uint32_t>(frame, 0))};
    case Command::kSetControllerMode:
      return SetControllerMode{static_cast<ControlMode>(at<uint32_t>(frame, 0)),
                               static_cast<InputMode>(at<uint32_t>(frame, 4))};
    case Command::kSetInputPosition:
      return SetInputPosition{at<float>(frame, 0), feedforward_at(frame, 4), feedforward_at(frame, 6)};
    case Command::kSetLimits:
      return SetLimits{at<float>(frame, 0), at<float>(frame, 4)};
    case Command::kClearErrors:
      return ClearErrors{(at<uint8_t>(frame, 0) & 1U) != 0};
    case Command::kEstop:
      break;
  }
  return Estop{};
}

bool is_finite(const Message& message) {
  if (const auto* m = std::get_if<EncoderEstimates>(&message))
    return std::isfinite(m->position) && std::isfinite(m->velocity);
  if (const auto* m = std::get_if<SetInputPosition>(&message)) return std::isfinite(m->position);
  if (const auto* m = std::get_if<SetLimits>(&message))
    return std::isfinite(m->velocity) && std::isfinite(m->current);
  return true;
}

std::optional<Request> request_of(Command command) {
  if (command == Command::kGetError) return Request::kErrors;
  if (command == Command::kGetEncoderEstimates) return Request::kEncoderEstimates;
  return std::nullopt;
}

}  // namespace

Result<CanFrame> encode(Node node, const Message& message) {
  if (node.value > kMaxNode) {
    return fail(ErrorCode::kUsage, "ODrive node " + std::to_string(node.value) + ": nodes are 0 to 63");
  }
  Encoder encoder{node, {}};
  std::visit(encoder, message);
  if (!encoder.to.ok) {
    return fail(ErrorCode::kUsage,
                "frame " + to_string(encoder.to.frame.id) +
                    ": a number is not finite or beyond what the message holds; a feed-forward "
                    "goes to 32.767 turns/s and 32.767 Nm");
  }
  return encoder.to.frame;
}

Decoded<Addressed> decode(const CanFrame& frame, std::span<const Node> nodes) {
  const auto fault = [&](CodecFault::Kind kind, uint8_t expected = 0) {
    return tl::unexpected(CodecFault{kind, frame.id, frame.length, expected});
  };
  if (frame.id.extended || frame.fd) return fault(CodecFault::Kind::kWrongKind);
  const Node node{static_cast<uint8_t>(frame.id.value >> kCommandBits)};
  if (std::find(nodes.begin(), nodes.end(), node) == nodes.end())
    return fault(CodecFault::Kind::kUnknownNode);
  const auto command = static_cast<Command>(frame.id.value & kCommandMask);
  const auto length = length_of(command);
  if (!length) return fault(CodecFault::Kind::kUnknownId);
  if (frame.remote) {
    const auto request = request_of(command);
    if (!request) return fault(CodecFault::Kind::kWrongKind);
    return Addressed{node, *request};
  }
  if (frame.length != *length) return fault(CodecFault::Kind::kWrongLength, *length);
  const Message message = message_of(command, frame);
  if (!is_finite(message)) return fault(CodecFault::Kind::kNotFinite);
  return Addressed{node, message};
}

CanFilter filter_of(Node node) {
  return {{uint32_t{node.value} << kCommandBits, false}, uint32_t{kMaxNode} << kCommandBits};
}

}  // namespace cairn::odrive
