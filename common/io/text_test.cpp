// SPDX-License-Identifier: Apache-2.0
#include "common/io/text.h"

#include <gmock/gmock.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <random>

#include "common/io/test_directory.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(Timestamps, TextAndBackIsTheSameNanosecond) {
  std::mt19937_64 random(7);
  std::uniform_int_distribution<int64_t> any(-4'600'000'000'000'000'000, 4'600'000'000'000'000'000);
  for (int i = 0; i < 1000; ++i) {
    const Timestamp time{any(random)};
    const auto text = format_timestamp(time);
    const auto back = parse_timestamp(text);
    ASSERT_TRUE(back) << text;
    ASSERT_EQ(back->nanoseconds, time.nanoseconds) << text;
  }
}

TEST(Timestamps, DecimalsOfAnyLengthAreExact) {
  EXPECT_EQ(parse_timestamp("1403715273.262143")->nanoseconds, 1'403'715'273'262'143'000);
  EXPECT_EQ(parse_timestamp("1403715273.262142976")->nanoseconds, 1'403'715'273'262'142'976);
  EXPECT_EQ(parse_timestamp("0.1234567896")->nanoseconds, 123'456'790);
  EXPECT_EQ(parse_timestamp("0.9999999999")->nanoseconds, 1'000'000'000);
  EXPECT_EQ(parse_timestamp("-0.5")->nanoseconds, -500'000'000);
  EXPECT_EQ(parse_timestamp("7")->nanoseconds, 7'000'000'000);
  EXPECT_EQ(parse_timestamp(".25")->nanoseconds, 250'000'000);
  EXPECT_NEAR(parse_timestamp("1.305031098665900e+09")->seconds(), 1305031098.6659, 1e-6);
}

TEST(Timestamps, RefusesWhatIsNotSeconds) {
  for (const auto* text : {"", "-", ".", "1.2.3", "1,5", "abc", "1403715273262142976", "1e40", "nan", "inf",
                           "0x10", "1 2", "--1"}) {
    EXPECT_FALSE(parse_timestamp(text)) << text;
  }
}

TEST(Numbers, WholeFieldOrNothing) {
  EXPECT_EQ(parse_number("-1.5e-3"), -1.5e-3);
  for (const auto* text : {"", "1x", " 1", "nan", "inf", "1,5"}) EXPECT_FALSE(parse_number(text)) << text;
}

TEST(Lines, KeepTheirNumbersAndLoseTheirEnds) {
  const auto lines = data_lines("# a\r\n,,\r\n  one two\t\r\n#b\nlast");
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0].number, 3u);
  EXPECT_EQ(lines[0].text, "one two");
  EXPECT_EQ(lines[1].number, 5u);
  EXPECT_EQ(lines[1].text, "last");
  EXPECT_THAT(split_fields(" a\tb,c  d "), ElementsAre("a", "b", "c", "d"));
  EXPECT_TRUE(split_fields(" \t ").empty());
}

TEST(Tables, AHeadingWithoutAMarkIsLeftOut) {
  for (const std::string heading :
       {"timestamp filename", "timestamp [ns],filename", "time", "timestamp tx ty tz qx qy qz qw",
        "\"timestamp\",\"filename\"", "%time,field.x", "t p_x [m] v_x [m s^-1]"}) {
    EXPECT_TRUE(is_heading(heading)) << heading;
    const std::string table = "# c\n" + heading + "\n1 a\n";  // keeps the views alive
    const auto rows = table_rows(table);
    ASSERT_EQ(rows.size(), 1u) << heading;
    EXPECT_EQ(rows[0].number, 3u);
  }
  for (const std::string row : {"0.0 a.png", "nan nan", "soon 1", "l311868163.9 a.png", "-1", "1e9", ""}) {
    EXPECT_FALSE(is_heading(row)) << row;
  }
  EXPECT_EQ(table_rows("garbage\n").size(), 1u) << "the one row there is must be complained of";
}

TEST(ListedFiles, ABackslashIsASlashUnlessAFileHasIt) {
  const TestDirectory directory;
  EXPECT_EQ(listed_file(directory.path(), "rgb\\0.png"), directory.path() / "rgb/0.png");
  EXPECT_EQ(listed_file(directory.path(), "rgb/0.png"), directory.path() / "rgb/0.png");
  std::ofstream(directory.path() / "a\\b.png") << "x";
  EXPECT_EQ(listed_file(directory.path(), "a\\b.png"), directory.path() / "a\\b.png");
}

TEST(ReadTextFile, IsPlainText) {
  const TestDirectory directory;
  const auto path = directory.path() / "a.txt";
  std::ofstream(path) << "\xef\xbb\xbf# c\r1 2\r";
  const auto text = read_text_file(path);
  ASSERT_TRUE(text) << text.error().message;
  ASSERT_EQ(data_lines(*text).size(), 1u);
  EXPECT_EQ(data_lines(*text)[0].text, "1 2");
  std::ofstream(path) << std::string("\xff\xfe\x31\0", 4);
  EXPECT_THAT(read_text_file(path).error().message, HasSubstr(path.string() + ": is UTF-16"));
  EXPECT_EQ(read_text_file("/nowhere/a.txt").error().code, ErrorCode::kNotFound);
}

TEST(Quotes, AreShortAndPrintable) {
  EXPECT_EQ(in_quotes("a\nb"), "'a b'");
  EXPECT_EQ(in_quotes("K\xfc\u202e"), "'K\\xfc\\u202e'");
  EXPECT_EQ(in_quotes(std::string(59, 'x') + "ü"), "'" + std::string(59, 'x') + "...'");
  EXPECT_EQ(in_quotes(std::string(1000, 'x')), "'" + std::string(60, 'x') + "...'");
}

TEST(ReadFile, ErrorsNameTheFile) {
  const auto missing = read_file("/nowhere/a.txt");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(missing.error().message, HasSubstr("/nowhere/a.txt"));
  EXPECT_EQ(read_file("/tmp").error().code, ErrorCode::kIo);
  const TestDirectory directory;
  const auto path = directory.path() / "big.txt";
  std::ofstream(path) << "12345";
  EXPECT_EQ(*read_file(path, 5), "12345");
  EXPECT_EQ(read_file(path, 4).error().code, ErrorCode::kDamaged);
}

TEST(CannotBeWritten, GivesTheSystemsReasonIfThereIsOne) {
  errno = ENOSPC;
  EXPECT_EQ(cannot_be_written("a/b.txt"),
            std::string("a/b.txt: cannot be written: ") + std::strerror(ENOSPC));
  errno = 0;
  EXPECT_EQ(cannot_be_written("a/b.txt"), "a/b.txt: cannot be written");
}

}  // namespace
}  // namespace cairn
