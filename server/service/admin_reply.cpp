// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_reply.h"

#include <variant>

#include "common/io/json_text.h"
#include "server/service/admin_json.h"

namespace cairn {

using nlohmann::json;

namespace {

/// Most bytes of the items of a page; the rest is for what frames them.
constexpr size_t kMaxPageBytes = wire::kMaxAdminText - 1000;

// What is too short to be described elsewhere.

json describe(const told::Nothing&) {
  return json::object();
}

json describe(const told::Piece&) {
  return json::object();
}

json describe(const told::Done& done) {
  json content{{"done", done.what}};
  if (!done.note.empty()) content["note"] = done.note;
  return content;
}

json describe(const told::GonePart&) {
  return {{"gone", true}};
}

json describe(const told::GoneMap& gone) {
  return {{"id", to_hex(gone.map.bytes)}};
}

json describe(const told::Untagged& untagged) {
  return {{"tag", untagged.tag}};
}

json describe(const told::ImagePiece& piece) {
  return {{"bytes", piece.bytes}};
}

json describe(const told::DroppedProposal& dropped) {
  return {{"id", dropped.id}};
}

}  // namespace

ReplyPage::ReplyPage(std::initializer_list<const char*> lists) : content_{{"more", false}} {
  for (const char* list : lists) content_[list] = json::array();
}

bool ReplyPage::add(const char* list, const json& item) {
  bytes_ += json_ascii(item).size() + 1;
  if (bytes_ > kMaxPageBytes) content_["more"] = true;
  if (content_["more"]) return false;
  content_[list].push_back(item);
  return true;
}

json content_of(const told::Answer& answer) {
  return std::visit([](const auto& one) { return describe(one); }, answer);
}

wire::AdminReply reply_of(const OperatorAnswer& answer) {
  wire::AdminReply reply;
  if (answer) {
    reply.text = json_ascii(content_of(*answer));
    if (const auto* piece = std::get_if<told::Piece>(&*answer)) reply.data = piece->data;
    if (const auto* piece = std::get_if<told::ImagePiece>(&*answer)) reply.data = piece->data;
    return reply;
  }
  // Whatever else it is to us, to the operator it is the server's no; a disk that takes nothing is none.
  const ErrorCode code = answer.error().code;
  const bool own_words = code == ErrorCode::kUsage || code == ErrorCode::kDamaged || code == ErrorCode::kIo;
  reply.result = static_cast<uint8_t>(exit_code(own_words ? code : ErrorCode::kRefused));
  reply.text = words_of(answer.error());
  return reply;
}

}  // namespace cairn
