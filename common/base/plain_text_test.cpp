// SPDX-License-Identifier: Apache-2.0
#include "common/base/plain_text.h"

#include <gmock/gmock.h>

namespace cairn {
namespace {

using ::testing::HasSubstr;
using namespace std::string_literals;

TEST(PlainText, LosesTheByteOrderMarkAndNothingElse) {
  EXPECT_EQ(*plain_text("\xef\xbb\xbf# a\r\nb\n", "f"), "# a\r\nb\n");
  EXPECT_EQ(*plain_text("\xef\xbb\xbf", "f"), "");
  for (const auto& text : {""s, "a"s, "caf\xc3\xa9\n"s, "caf\xe9\n"s, "a\xef\xbb\xbf"s})
    EXPECT_EQ(*plain_text(text, "f"), text);
}

TEST(PlainText, CarriageReturnsEndLinesOnlyWhereNothingElseDoes) {
  EXPECT_EQ(*plain_text("1 a\r2 b\r", "f"), "1 a\n2 b\n");
  EXPECT_EQ(*plain_text("1 a\r\n2 b\r\n", "f"), "1 a\r\n2 b\r\n");
}

TEST(PlainText, WideTextIsNamedWithTheWayOut) {
  struct Case {
    std::string bytes;
    const char* encoding;
    const char* remedy;
  };
  const Case cases[] = {{"\xff\xfe"
                         "1\0 \0"s,
                         "UTF-16", "iconv -f UTF-16 -t UTF-8 a.txt"},
                        {"\xfe\xff\0001\0 "s, "UTF-16", "iconv -f UTF-16 -t"},
                        {"#\0 \0t\0"s, "UTF-16", "iconv -f UTF-16LE -t"},
                        {"\0#\0 \0t"s, "UTF-16", "iconv -f UTF-16BE -t"},
                        {"\xff\xfe\0\0#\0\0\0"s, "UTF-32", "iconv -f UTF-32 -t"},
                        {"\0\0\xfe\xff\0\0\0#"s, "UTF-32", "iconv -f UTF-32 -t"}};
  for (const Case& c : cases) {
    const auto text = plain_text(c.bytes, "a.txt");
    ASSERT_FALSE(text) << c.remedy;
    EXPECT_EQ(text.error().code, ErrorCode::kDamaged);
    EXPECT_THAT(text.error().message, HasSubstr("a.txt: is "s + c.encoding));
    EXPECT_THAT(text.error().message, HasSubstr(c.remedy));
  }
}

TEST(PlainText, BytesOfValueZeroAreNoText) {
  const auto text = plain_text("PK\3\4 1 2\0\0"s, "a.npz");
  ASSERT_FALSE(text);
  EXPECT_THAT(text.error().message, HasSubstr("a.npz: is not text"));
}

}  // namespace
}  // namespace cairn
