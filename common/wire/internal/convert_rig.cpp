// SPDX-License-Identifier: Apache-2.0
// Conversion of what a rig, its commander and the server say to each other.
#include "common/map/ids.h"
#include "common/wire/internal/convert_common.h"
#include "common/wire/rig_messages.h"

namespace cairn::wire::internal {
namespace {

constexpr double kMaxAngle = 100;          ///< [rad] a rate of 100 rad/s likewise is no shoulder's
constexpr double kMaxAcceleration = 1000;  ///< [m/s^2]
constexpr uint8_t kMaxFault = 63;
constexpr float kMaxSigma = 10;  ///< [s]

template <typename T, size_t N>
void require_within(const T (&values)[N], double most, const char* what, Check* check) {
  for (const T value : values) check->require(std::abs(value) <= most, what);  // false for NaN
}

void require_mode(uint8_t mode, Check* check) {
  check->require(is_enumerator<RigMode>(mode), "unknown mode");
}

cairn_RigAxis encode_axis(const RigAxisState& axis) {
  return {static_cast<uint8_t>(axis.condition), axis.fault, axis.position_known, axis.position, axis.rate};
}

RigAxisState decode_axis(const cairn_RigAxis& axis) {
  return {static_cast<RigAxisCondition>(axis.condition), axis.fault, axis.position_known, axis.position,
          axis.rate};
}

void check_axis(const cairn_RigAxis& axis, Check* check) {
  check->require(is_enumerator<RigAxisCondition>(axis.condition), "unknown condition");
  check->require(axis.fault <= kMaxFault, "unknown fault");
  check->require(std::abs(axis.position) <= kMaxAngle && std::abs(axis.rate) <= kMaxAngle,
                 "axis out of range");
}

cairn_RigInertial encode_imu(const RigImu& imu) {
  cairn_RigInertial encoded{};
  encoded.time = imu.time.nanoseconds;
  put_vector(imu.rate, encoded.rate);
  put_vector(imu.acceleration, encoded.acceleration);
  encoded.attitude_known = imu.attitude_known;
  put_vector(imu.world_from_head.coeffs(), encoded.world_from_head);
  encoded.clock_offset = imu.clock_offset;
  return encoded;
}

RigImu decode_imu(const cairn_RigInertial& imu) {
  const auto& q = imu.world_from_head;
  return {{imu.time},         get_vector(imu.rate),     get_vector(imu.acceleration),
          imu.attitude_known, {q[3], q[0], q[1], q[2]}, imu.clock_offset};
}

void check_rotation(const double (&q)[4], Check* check) {
  check->pose({.rotation = {q[0], q[1], q[2], q[3]}, .translation = {}});
}

/// Checks a sample of the IMU: a RigInertial or a RigSample.
template <typename Measured>
void check_measured(const Measured& measured, Check* check) {
  check->time(measured.time);
  require_within(measured.rate, kMaxAngle, "rate of turn out of range", check);
  require_within(measured.acceleration, kMaxAcceleration, "acceleration out of range", check);
}

void check_imu(const cairn_RigInertial& imu, Check* check) {
  check_measured(imu, check);
  check->time(imu.clock_offset);
  check_rotation(imu.world_from_head, check);
}

void encode_rotation(const std::optional<Eigen::Quaterniond>& rotation, bool* known, double (&q)[4]) {
  *known = rotation.has_value();
  put_vector(rotation.value_or(Eigen::Quaterniond::Identity()).coeffs(), q);
}

std::optional<Eigen::Quaterniond> decode_rotation(bool known, const double (&q)[4]) {
  return known ? std::optional(Eigen::Quaterniond(q[3], q[0], q[1], q[2])) : std::nullopt;
}

/// Encodes the part of a rig's state that is for the tracker of its camera.
void encode_for_tracker(const RigState& message, Scratch* scratch, cairn_RigState* sample) {
  fill_sequence(message.samples.size(), scratch, &sample->samples, [&](size_t i, cairn_RigSample& out) {
    const RigImuSample& measured = message.samples[i];
    out.time = measured.time.nanoseconds;
    put_vector(measured.rate, out.rate);
    put_vector(measured.acceleration, out.acceleration);
  });
  encode_rotation(message.camera_from_imu, &sample->mount_known, sample->camera_from_imu);
  sample->calibrated = message.calibrated_offset.has_value();
  sample->calibrated_offset = message.calibrated_offset.value_or(0);
  encode_rotation(message.base_from_camera, &sample->aim_known, sample->base_from_camera);
}

void check_for_tracker(const cairn_RigState& sample, Check* check) {
  check->count(sample.samples, kMaxRigSamples);
  if (!check->passed()) return;
  for (uint32_t i = 0; i < sample.samples._length; ++i) {
    check_measured(sample.samples._buffer[i], check);
    check->require(i == 0 || sample.samples._buffer[i].time > sample.samples._buffer[i - 1].time,
                   "samples out of order");
  }
  if (sample.mount_known) check_rotation(sample.camera_from_imu, check);
  check->time(sample.calibrated_offset);
  if (sample.aim_known) check_rotation(sample.base_from_camera, check);
}

void decode_for_tracker(const cairn_RigState& sample, RigState* message) {
  for (uint32_t i = 0; i < sample.samples._length; ++i) {
    const cairn_RigSample& measured = sample.samples._buffer[i];
    message->samples.push_back(
        {{measured.time}, get_vector(measured.rate), get_vector(measured.acceleration)});
  }
  message->camera_from_imu = decode_rotation(sample.mount_known, sample.camera_from_imu);
  if (sample.calibrated) message->calibrated_offset = sample.calibrated_offset;
  message->base_from_camera = decode_rotation(sample.aim_known, sample.base_from_camera);
}

}  // namespace

// ---- RigCommand

template <>
cairn_RigCommand encode(const RigCommand& message, Scratch* scratch) {
  cairn_RigCommand sample{};
  sample.rig = borrow(message.rig);
  sample.schema_version = kSchemaVersion;
  sample.commander = borrow(message.commander);
  sample.order = {message.order.session.value, message.order.seq};
  sample.mode = static_cast<uint8_t>(message.mode);
  put_vector(message.target, sample.target);
  sample.seen = message.seen.nanoseconds;
  std::copy(message.angles.begin(), message.angles.end(), sample.angles);
  std::copy(message.rates.begin(), message.rates.end(), sample.rates);
  sample.pattern = static_cast<uint8_t>(message.pattern);
  fill_sequence(message.further.size(), scratch, &sample.further,
                [&](size_t i, cairn_RigDirection& out) { put_vector(message.further[i], out.direction); });
  return sample;
}

template <>
RigCommand decode_key<RigCommand>(const cairn_RigCommand& sample) {
  RigCommand message;
  message.rig = get_text(sample.rig);
  return message;
}

template <>
Result<RigCommand> decode<RigCommand>(const cairn_RigCommand& sample) {
  Check check;
  check.schema(sample.schema_version);
  require_name(sample.rig, false, "not the name of a rig", &check);
  require_name(sample.commander, false, "not the name of a commander", &check);
  check.command(sample.order);
  require_mode(sample.mode, &check);
  for (const double value : sample.target) check.length(value);
  require_within(sample.angles, kMaxAngle, "angle out of range", &check);
  require_within(sample.rates, kMaxAngle, "rate out of range", &check);
  check.require(is_enumerator<RigSearchPattern>(sample.pattern), "unknown pattern of a search");
  check.count(sample.further, kMaxFurtherDirections);
  for (uint32_t i = 0; check.passed() && i < sample.further._length; ++i)
    for (const double value : sample.further._buffer[i].direction) check.length(value);
  if (!check.passed()) return unfit(check.what());
  RigCommand message = decode_key<RigCommand>(sample);
  message.pattern = static_cast<RigSearchPattern>(sample.pattern);
  for (uint32_t i = 0; i < sample.further._length; ++i)
    message.further.emplace_back(sample.further._buffer[i].direction);
  message.commander = get_text(sample.commander);
  message.order = decode_command(sample.order);
  message.mode = static_cast<RigMode>(sample.mode);
  message.target = Eigen::Vector3d(sample.target);
  message.seen = {sample.seen};
  std::copy(std::begin(sample.angles), std::end(sample.angles), message.angles.begin());
  std::copy(std::begin(sample.rates), std::end(sample.rates), message.rates.begin());
  return message;
}

template <>
size_t payload_bytes<RigCommand>(const cairn_RigCommand& sample) {
  return sizeof(sample) + text_bytes(sample.rig) + text_bytes(sample.commander);
}

// ---- RigState

template <>
cairn_RigState encode(const RigState& message, Scratch* scratch) {
  cairn_RigState sample{};
  sample.rig = borrow(message.rig);
  sample.schema_version = kSchemaVersion;
  sample.time = message.time.nanoseconds;
  sample.mode = static_cast<uint8_t>(message.mode);
  sample.commander = borrow(message.commander);
  sample.order = {message.order.session.value, message.order.seq};
  sample.refusal = borrow(message.refusal);
  sample.stopped = message.stopped;
  sample.drives_idle = message.drives_idle;
  for (size_t i = 0; i < message.axes.size(); ++i) sample.axes[i] = encode_axis(message.axes.at(i));
  sample.has_imu = message.has_imu;
  sample.imu = encode_imu(message.imu);
  sample.trouble = borrow(message.trouble);
  sample.on_target = message.on_target;
  sample.out_of_reach = message.out_of_reach;
  sample.sees_target = message.sees_target;
  sample.looked_at = message.looked_at;
  sample.rounds = message.rounds;
  sample.camera_clock_known = message.camera_clock.known;
  sample.camera_offset = message.camera_clock.offset;
  sample.camera_offset_sigma = message.camera_clock.sigma;
  sample.ordered_by = borrow(message.ordered_by);
  sample.ordered = static_cast<uint8_t>(message.ordered);
  encode_for_tracker(message, scratch, &sample);
  return sample;
}

template <>
RigState decode_key<RigState>(const cairn_RigState& sample) {
  RigState message;
  message.rig = get_text(sample.rig);
  return message;
}

template <>
Result<RigState> decode<RigState>(const cairn_RigState& sample) {
  Check check;
  check.schema(sample.schema_version);
  require_name(sample.rig, false, "not the name of a rig", &check);
  require_mode(sample.mode, &check);
  require_name(sample.commander, true, "not the name of a commander", &check);
  check.text(sample.refusal, kMaxRigText);
  for (const cairn_RigAxis& axis : sample.axes) check_axis(axis, &check);
  check_imu(sample.imu, &check);
  check.time(sample.time);
  check.text(sample.trouble, kMaxRigText);
  check.require(sample.looked_at >= 0 && sample.looked_at <= 1, "share out of range");
  check.time(sample.camera_offset);
  check.require(sample.camera_offset_sigma >= 0 && sample.camera_offset_sigma <= kMaxSigma,
                "deviation out of range");
  require_name(sample.ordered_by, true, "not the name of a commander", &check);
  require_mode(sample.ordered, &check);
  check_for_tracker(sample, &check);
  if (!check.passed()) return unfit(check.what());
  RigState message = decode_key<RigState>(sample);
  message.time = {sample.time};
  message.mode = static_cast<RigMode>(sample.mode);
  message.commander = get_text(sample.commander);
  message.order = decode_command(sample.order);
  message.refusal = get_text(sample.refusal);
  message.stopped = sample.stopped;
  message.drives_idle = sample.drives_idle;
  for (size_t i = 0; i < message.axes.size(); ++i) message.axes.at(i) = decode_axis(sample.axes[i]);
  message.has_imu = sample.has_imu;
  message.imu = decode_imu(sample.imu);
  message.trouble = get_text(sample.trouble);
  message.on_target = sample.on_target;
  message.out_of_reach = sample.out_of_reach;
  message.sees_target = sample.sees_target;
  message.looked_at = sample.looked_at;
  message.rounds = sample.rounds;
  message.camera_clock = {sample.camera_clock_known, sample.camera_offset, sample.camera_offset_sigma};
  message.ordered_by = get_text(sample.ordered_by);
  message.ordered = static_cast<RigMode>(sample.ordered);
  decode_for_tracker(sample, &message);
  return message;
}

template <>
size_t payload_bytes<RigState>(const cairn_RigState& sample) {
  return sizeof(sample) + text_bytes(sample.rig) + text_bytes(sample.commander) + text_bytes(sample.refusal) +
         text_bytes(sample.trouble) + text_bytes(sample.ordered_by) + sequence_bytes(sample.samples);
}

}  // namespace cairn::wire::internal
