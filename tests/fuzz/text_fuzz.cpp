// SPDX-License-Identifier: Apache-2.0
//
// Texts, names, times and addresses of any origin: what makes them safe to show, and the small parsers that
// files and messages have in common.
#include <cmath>

#include "client/capture/source_uri.h"
#include "client/capture/stamp_list.h"
#include "common/base/plain_text.h"
#include "common/base/utc.h"
#include "common/base/utf8.h"
#include "common/io/text.h"
#include "common/map/ids.h"
#include "common/wire/partition.h"
#include "common/wire/rig_messages.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

void show(std::string_view text) {
  const std::string line = one_line(text);
  demand(!fault_of_text(line), "what one_line() gives can be shown");
  demand(fault_of_text(text) || line == text, "one_line() leaves a text without fault as it is");
  demand(!fault_of_text(in_quotes(text)), "what in_quotes() gives can be shown");
  const std::string lines = many_lines(text);
  for (const TextLine& one : all_lines(lines))
    demand(!fault_of_text(one.text), "what many_lines() gives can be shown line by line");
  static_cast<void>(is_invisible(text));
  demand(text_width(padded(std::string(line), 20)) >= 20, "a padded text is as wide as it must be");
}

void part(std::string_view text) {
  std::string together;
  for (const std::string_view letter : letters(text)) {
    demand(!letter.empty(), "no letter is empty");
    together += letter;
  }
  demand(together == text, "its letters are the text");
  for (const size_t bytes : {size_t{0}, size_t{1}, size_t{5}, text.size() / 2, text.size()}) {
    const std::string_view cut = cut_text(text, bytes);
    demand(cut.size() <= bytes && text.starts_with(cut), "what is cut is the beginning");
    demand(fault_of_text(text) || !fault_of_text(cut), "what is cut of a text without fault has none");
  }
  std::string again;
  for (const char32_t character : code_points(text)) again += to_utf8(character);
  demand(fault_of_text(text) || again == text, "a text is its characters");
}

void read_lines(std::string_view text) {
  const auto plain = plain_text(std::string(text), "file");
  if (!plain) return demand(!plain.error().message.empty(), "a refusal has a reason");
  static_cast<void>(data_lines(*plain));
  for (const TextLine& row : table_rows(*plain)) {
    demand(!split_fields(row.text).empty(), "a row has a field");
    static_cast<void>(is_heading(row.text));
  }
}

void read_times(std::string_view text) {
  if (const auto time = parse_timestamp(text))
    demand(parse_timestamp(format_timestamp(*time)) == time, "a time is written and read back");
  if (const auto time = parse_utc(text)) {
    const auto again = parse_utc(to_utc(*time));
    demand(again && *again == *time, "a time of day is written and read back");
  }
  for (const TimeUnit unit :
       {TimeUnit::kSeconds, TimeUnit::kMilliseconds, TimeUnit::kMicroseconds, TimeUnit::kNanoseconds}) {
    static_cast<void>(parse_stamp(text, unit));
    static_cast<void>(other_unit_hint(text, unit));
  }
  if (const auto number = parse_number(text)) demand(std::isfinite(*number), "a number is finite");
}

void read_names(std::string_view text) {
  if (const auto bytes = from_hex(text))
    demand(from_hex(to_hex(*bytes)).value() == *bytes, "an id is written and read back");
  if (const auto whose = wire::parse_partition(text)) {
    demand(is_valid_name(whose->client), "a partition is of a client with a name");
    const std::string again =
        whose->map ? wire::map_partition(whose->client, *whose->map) : wire::client_partition(whose->client);
    demand(again == text, "a partition is its identity's");
  }
  if (const auto name = wire::parse_operator_partition(text))
    demand(wire::operator_partition(*name) == text, "a partition is its operator's");
  static_cast<void>(wire::parse_rig_mode(text));
  static_cast<void>(wire::parse_rig_search(text));
  static_cast<void>(client_id_from_name(text));
  if (const auto uri = parse_source_uri(text)) {
    demand(!uri->scheme.empty() && !uri->path.empty(), "a source has a scheme and a path");
    static_cast<void>(uri->positive_number("fps", 30));
    static_cast<void>(uri->check_options({"fps"}));
  }
}

}  // namespace

void decode(Bytes bytes) {
  const std::string_view text = text_of(bytes);
  show(text);
  part(text);
  read_lines(text);
  read_times(text);
  read_names(text);
}

std::vector<Input> seeds() {
  constexpr const char* kTexts[] = {
      "kettle",
      "K\xc3\xbc\x63he \xe2\x80\x94 \xf0\x9f\x91\xa9\xe2\x80\x8d\xf0\x9f\x9a\x80",
      "\xd9\x85\xdb\x8c\xe2\x80\x8c\xd8\xae\xd9\x88\xd8\xa7\xd9\x87\xd9\x85",
      "e\xcc\x81\xcc\x82 \xe6\x9c\xba",
      "a\xc2\x9b[2J\x1b[2J\xe2\x80\xae\xff",
      "1403636579763555584",
      "1403636579.763555584",
      "-1.5e3",
      "2026-12-01T12:00:00Z",
      "2199-12-31",
      "00112233445566778899aabbccddeeff",
      "client.phone-1",
      "client.phone-1.map.00112233445566778899aabbccddeeff",
      "operator.ann",
      "fixate",
      "euroc:/data/MH_01?camera=cam1&unit=ns",
      "# time x y\n1.0 2 3\r\n\r\n4,5,6\n",
      "\xef\xbb\xbf# \rb\r"};
  std::vector<Input> all;
  for (const char* text : kTexts) all.push_back(copy_of(text));
  return all;
}

}  // namespace cairn::fuzz
