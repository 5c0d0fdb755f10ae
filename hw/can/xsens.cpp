// SPDX-License-Identifier: Apache-2.0
#include "hw/can/xsens.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "hw/can/payload.h"

namespace cairn::xsens {
namespace {

constexpr double kQuaternionStep = 1.0 / 32767;
constexpr double kEulerStep = std::numbers::pi / 180 / (1 << 7);
constexpr double kRateStep = 1.0 / (1 << 9);
constexpr double kAccelerationStep = 1.0 / (1 << 8);

/// The parts of a payload one after another.
struct Writer {
  CanFrame frame;
  bool ok = true;

  template <typename T>
  void put(T value) {
    put_number(value, std::span(frame.data), frame.length, kByteOrder);
    frame.length = static_cast<uint8_t>(frame.length + sizeof value);
  }
  void put_steps(double value, double step) {
    using Limits = std::numeric_limits<int16_t>;
    ok = ok && std::isfinite(value);
    put(ok ? static_cast<int16_t>(std::clamp<double>(std::round(value / step), Limits::min(), Limits::max()))
           : int16_t{0});
  }
};

struct Encoder {
  const Ids& ids;
  Writer to;

  void operator()(const SampleTime& m) {
    to.frame.id.value = ids.sample_time;
    to.put(m.ticks);
  }
  void operator()(const GroupCounter& m) {
    to.frame.id.value = ids.group_counter;
    to.put(m.count);
  }
  void operator()(const StatusWord& m) {
    to.frame.id.value = ids.status_word;
    to.put(m.bits);
  }
  void operator()(const Quaternion& m) {
    to.frame.id.value = ids.quaternion;
    for (const double part : {m.w, m.x, m.y, m.z}) to.put_steps(part, kQuaternionStep);
  }
  void operator()(const Euler& m) {
    to.frame.id.value = ids.euler;
    for (const double angle : {m.roll, m.pitch, m.yaw}) to.put_steps(angle, kEulerStep);
  }
  void operator()(const RateOfTurn& m) {
    to.frame.id.value = ids.rate_of_turn;
    for (const double rate : m.rate) to.put_steps(rate, kRateStep);
  }
  void operator()(const Acceleration& m) {
    to.frame.id.value = ids.acceleration;
    for (const double part : m.acceleration) to.put_steps(part, kAccelerationStep);
  }
};

template <typename T>
T at(const CanFrame& frame, size_t offset) {
  return get_number<T>(frame.payload(), offset, kByteOrder);
}

/// The `index`-th of several numbers.
double steps(const CanFrame& frame, size_t index, double step) {
  return at<int16_t>(frame, index * sizeof(int16_t)) * step;
}

std::array<double, 3> three_steps(const CanFrame& frame, double step) {
  return {steps(frame, 0, step), steps(frame, 1, step), steps(frame, 2, step)};
}

/// A kind of message: its identifier, its length, and what its payload says.
struct Kind {
  uint32_t Ids::*id;
  uint8_t length;
  Message (*decode)(const CanFrame&);
};

constexpr std::array<Kind, std::variant_size_v<Message>> kKinds = {
    {{&Ids::sample_time, 4, [](const CanFrame& f) -> Message { return SampleTime{at<uint32_t>(f, 0)}; }},
     {&Ids::group_counter, 2, [](const CanFrame& f) -> Message { return GroupCounter{at<uint16_t>(f, 0)}; }},
     {&Ids::status_word, 4, [](const CanFrame& f) -> Message { return StatusWord{at<uint32_t>(f, 0)}; }},
     {&Ids::quaternion, 8,
      [](const CanFrame& f) -> Message {
        return Quaternion{.x = steps(f, 1, kQuaternionStep),
                          .y = steps(f, 2, kQuaternionStep),
                          .z = steps(f, 3, kQuaternionStep),
                          .w = steps(f, 0, kQuaternionStep)};
      }},
     {&Ids::euler, 6,
      [](const CanFrame& f) -> Message {
        const auto angles = three_steps(f, kEulerStep);
        return Euler{angles[0], angles[1], angles[2]};
      }},
     {&Ids::rate_of_turn, 6,
      [](const CanFrame& f) -> Message { return RateOfTurn{three_steps(f, kRateStep)}; }},
     {&Ids::acceleration, 6,
      [](const CanFrame& f) -> Message { return Acceleration{three_steps(f, kAccelerationStep)}; }}}};

}  // namespace

Result<CanFrame> encode(const Message& message, const Ids& ids) {
  Encoder encoder{ids, {}};
  std::visit(encoder, message);
  if (!encoder.to.ok) {
    return fail(ErrorCode::kUsage, "frame " + to_string(encoder.to.frame.id) + ": a number is not finite");
  }
  return encoder.to.frame;
}

Decoded<Message> decode(const CanFrame& frame, const Ids& ids) {
  const auto fault = [&](CodecFault::Kind kind, uint8_t expected = 0) {
    return tl::unexpected(CodecFault{kind, frame.id, frame.length, expected});
  };
  if (frame.id.extended || frame.fd || frame.remote) return fault(CodecFault::Kind::kWrongKind);
  const auto kind = std::find_if(kKinds.begin(), kKinds.end(),
                                 [&](const Kind& candidate) { return ids.*candidate.id == frame.id.value; });
  if (kind == kKinds.end()) return fault(CodecFault::Kind::kUnknownId);
  if (frame.length != kind->length) return fault(CodecFault::Kind::kWrongLength, kind->length);
  return kind->decode(frame);
}

std::vector<CanFilter> filters_of(const Ids& ids) {
  std::vector<CanFilter> filters;
  filters.reserve(kKinds.size());
  for (const Kind& kind : kKinds) filters.push_back(CanFilter::only({ids.*kind.id, false}));
  return filters;
}

}  // namespace cairn::xsens
