// SPDX-License-Identifier: Apache-2.0
#include "server/admin/listing.h"

#include <gtest/gtest.h>

#include "common/base/utf8.h"

namespace cairn {
namespace {

using nlohmann::json;

std::string row_of(const std::string& text) {
  ::testing::internal::CaptureStdout();
  print_label({{"map", "desk"}, {"id", 1}, {"text", text}, {"author", "hand"}, {"position", {0, 0, 0}}});
  return ::testing::internal::GetCapturedStdout();
}

TEST(Listing, ColumnsStandUnderEachOtherWhateverTheScript) {
  const size_t column = row_of("vice").find(" by hand");
  for (const std::string text : {"Küche", "Ku\u0308che", "工作台", "стол", "K\xfc"}) {
    const std::string row = row_of(text);
    EXPECT_EQ(text_width(row.substr(0, row.find(" by hand"))), column) << row;
  }
}

TEST(Listing, NothingInItSteersTheTerminal) {
  for (const std::string text : {"a\u202eb",
                                 "a\xc2\x9b"
                                 "2J",
                                 "a\x1b[2J", "\xff", "de\u200bsk"}) {
    std::string row = row_of(text);
    ASSERT_EQ(row.back(), '\n');
    row.pop_back();
    EXPECT_EQ(fault_of_text(row), std::nullopt) << one_line(row);
  }
}

TEST(Listing, ARigSaysWhatItDoesAndWhatIsInItsWay) {
  const auto rows = [](const json& rig) {
    ::testing::internal::CaptureStdout();
    print_rig(rig);
    return ::testing::internal::GetCapturedStdout();
  };
  json rig = {{"rig", "shoulder"},    {"mode", "lock"}, {"commander", "tracker-3"}, {"stopped", false},
              {"drives_idle", false}, {"trouble", ""},  {"silent", false}};
  EXPECT_EQ(rows(rig), padded("shoulder", 24) + " lock, last commanded by tracker-3\n");
  rig["mode"] = "stop";
  rig["stopped"] = rig["drives_idle"] = true;
  rig["last_order"] = {{"by", "ada-71"}, {"mode", "stop"}, {"refusal", ""}};
  rig["trouble"] = "emergency\x1b stop";
  const std::string said = rows(rig);
  EXPECT_NE(said.find("EMERGENCY STOP, stop, drives let go"), std::string::npos) << said;
  EXPECT_NE(said.find("last order: stop, by ada-71\n"), std::string::npos) << said;
  EXPECT_EQ(said.find('\x1b'), std::string::npos);
  rig["silent"] = true;
  EXPECT_NE(rows(rig).find("silent, was: stop"), std::string::npos);
}

}  // namespace
}  // namespace cairn
