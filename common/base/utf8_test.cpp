// SPDX-License-Identifier: Apache-2.0
#include "common/base/utf8.h"

#include <gtest/gtest.h>

#include <random>

#include "common/base/log.h"

namespace cairn {
namespace {

const std::vector<std::string> kSound = {"",     "desk 3", "Küche",         "Ku\u0308che",      "工作台",
                                         "стол", "مكتب",   "می\u200cخواهم", "👩\u200d🔧 ❤\ufe0f", "C:\\x\\u"};
const std::vector<std::string> kFaulty = {
    "K\xfc"
    "che",
    "caf\xe9",
    "a\xc0\xaf",         // overlong
    "\xed\xa0\x80",      // a surrogate
    "\xf4\x90\x80\x80",  // beyond Unicode
    "\xe5\xb7",          // cut
    "a\nb",
    "a\x1b[2J",
    "\x7f",
    "\xc2\x9b"
    "2J",  // C1: CSI in one character
    "a\u202egnp.exe",
    "\u2067",
    "de\u200bsk",
    "\ufeff"
    "desk",
    "so\u00adft",
    "a\u2028b",
    "desk\u200d",
    "کک\u200d\u200d",
    "\u3164",
    "\U000e0041"};

TEST(FaultOfText, IsFoundInWhatCannotBeSeenOrIsNoUtf8) {
  for (const auto& text : kSound) EXPECT_EQ(fault_of_text(text), std::nullopt) << text;
  for (const auto& text : kFaulty) EXPECT_NE(fault_of_text(text), std::nullopt) << one_line(text);
  EXPECT_EQ(*fault_of_text("K\xfc"), "byte 2 (0xfc) is no UTF-8");
  EXPECT_EQ(*fault_of_text("a\u202e"), "byte 2 begins the character U+202E, which cannot be seen");
}

TEST(OneLine, KeepsWhatIsSoundAndEscapesTheRest) {
  for (const auto& text : kSound) EXPECT_EQ(one_line(text), text);
  for (const auto& text : kFaulty) {
    EXPECT_EQ(fault_of_text(one_line(text)), std::nullopt) << one_line(text);
    EXPECT_FALSE(one_line(text).empty());
  }
  EXPECT_EQ(one_line("caf\xe9/s.json"), "caf\\xe9/s.json");
  EXPECT_EQ(one_line("a\u202e\xc2\x9b\U000e0041"), "a\\u202e\\u009b\\U000e0041");
  EXPECT_EQ(one_line("a\r\nb"), "a  b");
}

TEST(OneLine, AJoinerBehindWhatIsEscapedIsEscapedToo) {
  const std::string shown = one_line("a\xc2\x9b\xe2\x80\x8d");  // a C1 control, a joiner
  EXPECT_EQ(shown, "a\\u009b\\u200d");
  EXPECT_FALSE(fault_of_text(shown));
}

TEST(ManyLines, KeepsLineBreaksOnly) {
  EXPECT_EQ(many_lines("a\xe9\nb\x1b\n"), "a\\xe9\nb \n");
  EXPECT_EQ(many_lines("\n\nc"), "\n\nc");
}

/// Whatever is logged: a path, an exception's text, a label.
TEST(Log, IsSafeForATerminal) {
  testing::internal::CaptureStderr();
  make_logger("t", 0)->info("caf\xe9 \u202e\x1b[2J Küche 工作台");
  const std::string line = testing::internal::GetCapturedStderr();
  EXPECT_NE(line.find("caf\\xe9 \\u202e [2J Küche 工作台\n"), std::string::npos) << line;
}

TEST(SayError, IsSafeForATerminal) {
  testing::internal::CaptureStderr();
  say_error("cairnctl", "caf\xe9\n\x1b[2J");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "cairnctl: caf\\xe9  [2J\n");
}

/// Of random bytes and characters, so that sequences are broken at every place.
TEST(OneLine, IsWithoutFaultWhateverTheBytes) {
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    std::string text;
    for (int k = 0; k < 12; ++k) {
      if (random() % 2 == 0)
        text += static_cast<char>(random() % 256);
      else
        text += to_utf8(random() % 0x11000);
    }
    const std::string shown = one_line(text);
    ASSERT_EQ(fault_of_text(shown), std::nullopt) << shown;
    ASSERT_EQ(one_line(shown), shown);
    ASSERT_EQ(shown == text, !fault_of_text(text));
  }
}

TEST(Letters, AreWhatAReaderCounts) {
  EXPECT_EQ(letters("Ku\u0308che").size(), 5U);
  EXPECT_EQ(letters("工作台").size(), 3U);
  EXPECT_EQ(letters("👩\u200d🔧").size(), 1U);
  EXPECT_EQ(letters("a\xfc\xfc").size(), 3U);
  for (const auto& text : kFaulty) {
    std::string all;
    for (const std::string_view letter : letters(text)) all += letter;
    EXPECT_EQ(all, text);
  }
}

TEST(CutText, NeverBreaksALetterAndKeepsAllThatFits) {
  for (const auto& text : kSound) {
    for (size_t bytes = 0; bytes <= text.size(); ++bytes) {
      const auto cut = cut_text(text, bytes);
      EXPECT_LE(cut.size(), bytes);
      EXPECT_TRUE(text.starts_with(cut));
      EXPECT_EQ(fault_of_text(cut), std::nullopt) << text << " at " << bytes;
    }
  }
  EXPECT_EQ(cut_text("Ku\u0308che", 3), "K");
  EXPECT_EQ(cut_text("Ku\u0308che", 4), "Ku\u0308");
  EXPECT_EQ(cut_text("u\u0308\u0308\u0308", 4), "u\u0308");
}

TEST(TextWidth, IsThatOfATerminal) {
  EXPECT_EQ(text_width("Küche"), 5U);
  EXPECT_EQ(text_width("Ku\u0308che"), 5U);
  EXPECT_EQ(text_width("工作台"), 6U);
  for (const auto& text : {"Küche", "Ku\u0308che", "工作台", "K\xfc"})
    EXPECT_EQ(text_width(padded(text, 8)), 8U);
  EXPECT_EQ(padded("工作台", 2), "工作台");
}

TEST(IsInvisible, HoldsForBlanksOfAllKinds) {
  for (const auto* text : {"", " ", "\u00a0\u3000", "\u0308"}) EXPECT_TRUE(is_invisible(text)) << text;
  for (const auto* text : {"a", " 工", "\xfc"}) EXPECT_FALSE(is_invisible(text)) << text;
}

TEST(CodePoints, AreUndoneByToUtf8) {
  for (const auto& text : kSound) {
    std::string again;
    for (const char32_t character : code_points(text)) again += to_utf8(character);
    EXPECT_EQ(again, text);
  }
  EXPECT_EQ(to_utf8(0xd800), "");
}

}  // namespace
}  // namespace cairn
