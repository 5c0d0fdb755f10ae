// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/known_lines.h"

#include <dds/ddsrt/retcode.h>

#include <charconv>

namespace cairn::wire::internal {
namespace {

/// The number that a line ends with; 0: it ends with none.
int code_at_end(std::string_view line) {
  const size_t space = line.find_last_of(' ');
  const std::string_view word = space == std::string_view::npos ? line : line.substr(space + 1);
  int code = 0;
  (void)std::from_chars(word.data(), word.data() + word.size(), code);
  return code;
}

/// Why the system has not taken a datagram.
std::string why_not_sent(int code) {
  switch (code) {
    case DDS_RETCODE_NOT_ENOUGH_SPACE:
      return "it is larger than this network takes at once";
    case DDS_RETCODE_OUT_OF_RESOURCES:
      return "the system has no buffer left for it";
    case DDS_RETCODE_NOT_ALLOWED:
      return "the system does not allow it (a firewall?)";
    case DDS_RETCODE_NO_CONNECTION:
    case DDS_RETCODE_NO_NETWORK:
      return "there is no way to that address";
    default:
      return "the network refuses it (code " + std::to_string(code) + ")";
  }
}

/// "ddsi_udp_conn_write to udp/10.0.0.1:7410 failed with retcode -58"
std::optional<KnownLine> unsent(std::string_view line) {
  constexpr std::string_view kBegin = "ddsi_udp_conn_write to ";
  constexpr std::string_view kEnd = " failed with retcode";
  const size_t begin = line.find(kBegin);
  const size_t end = line.find(kEnd);
  if (begin == std::string_view::npos || end == std::string_view::npos || end < begin) return std::nullopt;
  const std::string_view to = line.substr(begin + kBegin.size(), end - begin - kBegin.size());
  return KnownLine{
      "a message to " + std::string(to) + " could not be sent: " + why_not_sent(code_at_end(line)), false};
}

}  // namespace

std::optional<KnownLine> known_line(std::string_view line) {
  // When keys have expired the middleware takes the participant apart itself, and finds nothing to delete
  // when the program ends.
  if (line.find("dds_participant_delete: internal error") != std::string_view::npos)
    return KnownLine{"the participant was gone before the program ended: its keys had expired", true};
  return unsent(line);
}

}  // namespace cairn::wire::internal
