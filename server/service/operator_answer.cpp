// SPDX-License-Identifier: Apache-2.0
#include "server/service/operator_answer.h"

#include "common/base/utf8.h"
#include "common/wire/messages.h"

namespace cairn {

OperatorAnswer refusal(Error error) {
  return tl::unexpected(std::move(error));
}

OperatorAnswer refusal(ErrorCode code, std::string message) {
  return fail(code, std::move(message));
}

OperatorAnswer refusal(const DeletedMap& map) {
  const std::string remedy = map.problem->code == ErrorCode::kDamaged
                                 ? "`cairnctl maps purge " + to_hex(map.header.id.bytes) +
                                       "` removes it for good, an archive of it can be imported then"
                                 : "nothing is known to be wrong with its file, which stays: see to that";
  return refusal(map.problem->code, map.problem->message + "; " + remedy);
}

OperatorAnswer unknown_map(const std::string& name_or_id) {
  return refusal(ErrorCode::kNotFound, "no map '" + name_or_id + "'; `cairnctl maps` lists them");
}

OperatorAnswer deleted_map(const std::string& name_or_id) {
  return refusal(ErrorCode::kNotFound, "map '" + name_or_id + "' is deleted; `cairnctl map " + name_or_id +
                                           " undelete` puts it back into service");
}

std::string words_of(const Error& refused) {
  return std::string(cut_text(one_line(refused.message), wire::kMaxAdminText));
}

}  // namespace cairn
