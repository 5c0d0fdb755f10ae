// SPDX-License-Identifier: Apache-2.0
// Conversion of labels, and of what people ask for.
#include "common/wire/internal/convert_common.h"

namespace cairn::wire::internal {

// ---- ClientRequest

template <>
cairn_ClientRequest encode(const ClientRequest& message, Scratch*) {
  cairn_ClientRequest sample{};
  put_id(message.client.bytes, sample.client_id);
  sample.schema_version = kSchemaVersion;
  sample.command = {message.command.session.value, message.command.seq};
  sample.action = static_cast<uint8_t>(message.action);
  put_id(message.map.bytes, sample.map_id);
  sample.label = message.label.value;
  sample.kind = static_cast<uint8_t>(message.kind);
  sample.text = borrow(message.text);
  sample.epoch = message.epoch.value;
  sample.reference = message.reference.value;
  sample.reference_from_label = encode_pose(message.reference_from_label);
  return sample;
}

template <>
ClientRequest decode_key<ClientRequest>(const cairn_ClientRequest& sample) {
  ClientRequest message;
  message.client = get_id<ClientId>(sample.client_id);
  return message;
}

template <>
Result<ClientRequest> decode<ClientRequest>(const cairn_ClientRequest& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.command(sample.command);
  check.require(is_enumerator<RequestAction>(sample.action), "unknown action");
  check.require(is_enumerator<LabelKind>(sample.kind), "unknown kind of label");
  check.text(sample.text, kMaxLabelBytes);
  check.pose(sample.reference_from_label);
  if (!check.passed()) return unfit(check.what());
  ClientRequest message = decode_key<ClientRequest>(sample);
  message.command = decode_command(sample.command);
  message.action = static_cast<RequestAction>(sample.action);
  message.map = get_id<MapId>(sample.map_id);
  message.label = {sample.label};
  message.kind = static_cast<LabelKind>(sample.kind);
  message.text = get_text(sample.text);
  message.epoch = {sample.epoch};
  message.reference = {sample.reference};
  message.reference_from_label = decode_pose(sample.reference_from_label);
  return message;
}

template <>
size_t payload_bytes<ClientRequest>(const cairn_ClientRequest& sample) {
  return sizeof(sample) + text_bytes(sample.text);
}

// ---- ClientReply

template <>
cairn_ClientReply encode(const ClientReply& message, Scratch* scratch) {
  auto sample = encode_decided<cairn_ClientReply>(message);
  fill_sequence(message.recent.size(), scratch, &sample.recent, [&](size_t i, cairn_RequestOutcome& out) {
    const RequestOutcome& outcome = message.recent[i];
    out.seq = outcome.seq;
    out.decision = static_cast<uint8_t>(outcome.decision);
    out.reason = borrow(outcome.reason);
    put_id(outcome.map.bytes, out.map_id);
    out.label = outcome.label.value;
  });
  return sample;
}

template <>
ClientReply decode_key<ClientReply>(const cairn_ClientReply& sample) {
  ClientReply message;
  message.client = get_id<ClientId>(sample.client_id);
  return message;
}

template <>
Result<ClientReply> decode<ClientReply>(const cairn_ClientReply& sample) {
  Check check;
  auto message = decode_decided<ClientReply>(sample, &check);
  if (!message) return message;
  for (uint32_t i = 0; i < sample.recent._length; ++i) {
    const cairn_RequestOutcome& outcome = sample.recent._buffer[i];
    check.require(is_enumerator<RequestDecision>(outcome.decision), "unknown decision");
    check.text(outcome.reason, kMaxReasonBytes);
    message->recent.push_back({outcome.seq,
                               static_cast<RequestDecision>(outcome.decision),
                               get_text(outcome.reason),
                               get_id<MapId>(outcome.map_id),
                               {outcome.label}});
  }
  return checked_message(check, *std::move(message));
}

template <>
size_t payload_bytes<ClientReply>(const cairn_ClientReply& sample) {
  size_t bytes = sizeof(sample) + sequence_bytes(sample.recent);
  for (uint32_t i = 0; i < sample.recent._length; ++i) bytes += text_bytes(sample.recent._buffer[i].reason);
  return bytes;
}

// ---- Label

template <>
cairn_Label encode(const LabelMessage& message, Scratch*) {
  cairn_Label sample{};
  const Label& label = message.label;
  put_id(message.map.bytes, sample.map_id);
  sample.label_id = label.id.value;
  sample.schema_version = kSchemaVersion;
  sample.epoch = message.epoch.value;
  sample.kind = static_cast<uint8_t>(label.kind);
  sample.text = borrow(label.text);
  sample.map_from_label = encode_pose(label.map_from_label);
  sample.author = borrow(label.author);
  sample.time = label.time.nanoseconds;
  return sample;
}

template <>
LabelMessage decode_key<LabelMessage>(const cairn_Label& sample) {
  LabelMessage message;
  message.map = get_id<MapId>(sample.map_id);
  message.label.id = {sample.label_id};
  return message;
}

template <>
Result<LabelMessage> decode<LabelMessage>(const cairn_Label& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.require(sample.label_id != 0, "label without a number");
  check.require(is_enumerator<LabelKind>(sample.kind), "unknown kind of label");
  check.text(sample.text, kMaxLabelBytes);
  check.text(sample.author, kMaxAuthorBytes);
  check.pose(sample.map_from_label);
  check.time(sample.time);
  if (!check.passed()) return unfit(check.what());
  LabelMessage message = decode_key<LabelMessage>(sample);
  message.epoch = {sample.epoch};
  message.label.kind = static_cast<LabelKind>(sample.kind);
  message.label.text = get_text(sample.text);
  message.label.map_from_label = decode_pose(sample.map_from_label);
  message.label.author = get_text(sample.author);
  message.label.time = {sample.time};
  return message;
}

template <>
size_t payload_bytes<LabelMessage>(const cairn_Label& sample) {
  return sizeof(sample) + text_bytes(sample.text) + text_bytes(sample.author);
}

}  // namespace cairn::wire::internal
