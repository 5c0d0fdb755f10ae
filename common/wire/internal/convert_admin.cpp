// SPDX-License-Identifier: Apache-2.0
// Conversion of what operators ask and are answered.
#include "common/wire/internal/convert_common.h"

namespace cairn::wire::internal {

// ---- AdminRequest

template <>
cairn_AdminRequest encode(const AdminRequest& message, Scratch*) {
  cairn_AdminRequest sample{};
  put_id(message.operator_id.bytes, sample.operator_id);
  sample.schema_version = kSchemaVersion;
  sample.command = {message.command.session.value, message.command.seq};
  sample.request = borrow(message.request);
  borrow_sequence(message.data, &sample.data);
  return sample;
}

template <>
AdminRequest decode_key<AdminRequest>(const cairn_AdminRequest& sample) {
  AdminRequest message;
  message.operator_id = get_id<ClientId>(sample.operator_id);
  return message;
}

template <>
Result<AdminRequest> decode<AdminRequest>(const cairn_AdminRequest& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.command(sample.command);
  check.text(sample.request, kMaxAdminText);
  check.count(sample.data, kMaxAdminData);
  if (!check.passed()) return unfit(check.what());
  AdminRequest message = decode_key<AdminRequest>(sample);
  message.command = decode_command(sample.command);
  message.request = get_text(sample.request);
  message.data = get_sequence<uint8_t>(sample.data);
  return message;
}

template <>
size_t payload_bytes<AdminRequest>(const cairn_AdminRequest& sample) {
  return sizeof(sample) + text_bytes(sample.request) + sequence_bytes(sample.data);
}

// ---- AdminReply

template <>
cairn_AdminReply encode(const AdminReply& message, Scratch*) {
  cairn_AdminReply sample{};
  put_id(message.operator_id.bytes, sample.operator_id);
  sample.schema_version = kSchemaVersion;
  sample.command = {message.command.session.value, message.command.seq};
  sample.result = message.result;
  sample.text = borrow(message.text);
  borrow_sequence(message.data, &sample.data);
  return sample;
}

template <>
AdminReply decode_key<AdminReply>(const cairn_AdminReply& sample) {
  AdminReply message;
  message.operator_id = get_id<ClientId>(sample.operator_id);
  return message;
}

template <>
Result<AdminReply> decode<AdminReply>(const cairn_AdminReply& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.command(sample.command);
  check.text(sample.text, kMaxAdminText);
  check.count(sample.data, kMaxAdminData);
  if (!check.passed()) return unfit(check.what());
  AdminReply message = decode_key<AdminReply>(sample);
  message.command = decode_command(sample.command);
  message.result = sample.result;
  message.text = get_text(sample.text);
  message.data = get_sequence<uint8_t>(sample.data);
  return message;
}

template <>
size_t payload_bytes<AdminReply>(const cairn_AdminReply& sample) {
  return sizeof(sample) + text_bytes(sample.text) + sequence_bytes(sample.data);
}

}  // namespace cairn::wire::internal
