// SPDX-License-Identifier: Apache-2.0
#include "client/capture/stamp_list.h"

#include <gmock/gmock.h>

#include "client/capture/source_files_fixture.h"

namespace cairn {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(Stamps, AreExactInEveryUnit) {
  const auto nanoseconds = [](const char* text, TimeUnit unit) {
    const auto time = parse_stamp(text, unit);
    return time ? std::optional(time->nanoseconds) : std::nullopt;
  };
  EXPECT_EQ(nanoseconds("1403715273.262142976", TimeUnit::kSeconds), 1403715273262142976);
  EXPECT_EQ(nanoseconds("1403715273262.142976", TimeUnit::kMilliseconds), 1403715273262142976);
  EXPECT_EQ(nanoseconds("1403715273262142.976", TimeUnit::kMicroseconds), 1403715273262142976);
  EXPECT_EQ(nanoseconds("1403715273262142976", TimeUnit::kNanoseconds), 1403715273262142976);
  EXPECT_EQ(nanoseconds("33", TimeUnit::kMilliseconds), 33'000'000);
  EXPECT_EQ(nanoseconds("-1", TimeUnit::kNanoseconds), -1);
  EXPECT_EQ(nanoseconds("0", TimeUnit::kNanoseconds), 0);
  for (const char* text : {"", ".", "-", "1.5", "12a", "1e3", "1.2.3", "99999999999999999999"})
    EXPECT_FALSE(parse_stamp(text, TimeUnit::kNanoseconds)) << text;
}

TEST(Stamps, AnotherUnitIsSuspectedWhereItGivesATimeOfOurYears) {
  EXPECT_THAT(other_unit_hint("1403715273262", TimeUnit::kSeconds), HasSubstr("unit=ms"));
  EXPECT_THAT(other_unit_hint("1403715273262142", TimeUnit::kSeconds), HasSubstr("unit=us"));
  EXPECT_THAT(other_unit_hint("1403715273262142976", TimeUnit::kSeconds), HasSubstr("unit=ns"));
  EXPECT_THAT(other_unit_hint("1403715273.26", TimeUnit::kNanoseconds), HasSubstr("unit=s "));
  EXPECT_EQ(other_unit_hint("soon", TimeUnit::kSeconds), "");
}

class StampedFiles : public FrameSourceFiles {
 protected:
  /// A list of one image at thirty times.
  void write_list(const std::string& name, double step) {
    write_image("mav0/cam0/data/0.png", 0);
    std::string list;
    for (int i = 0; i < 30; ++i)
      list += std::to_string(std::llround(i * step)) +
              (name == "rgb.txt" ? " mav0/cam0/data/0.png\n" : ",0.png\n");
    write_text(name, list);
  }
  static std::vector<std::string> notes_of(const std::string& uri) {
    const auto source = open_source(uri);
    EXPECT_TRUE(source) << source.error().message;
    std::vector<std::string> texts;
    if (source) {
      for (const auto& note : (*source)->notes()) texts.push_back(note.text);
    }
    return texts;
  }
  static Timestamp last_time(const std::string& uri) {
    const auto source = open_source(uri);
    EXPECT_TRUE(source) << source.error().message;
    return source ? take_all(**source).frames.back().time : Timestamp();
  }
};

TEST_F(StampedFiles, AListInAnotherUnitIsRefusedUntilTheUnitIsGiven) {
  write_list("rgb.txt", 33);
  expect_open_error(uri("tum"), ErrorCode::kDamaged, "as milliseconds it is 0.033 s: add unit=ms");
  EXPECT_EQ(last_time(uri("tum", "?unit=ms")), Timestamp{957'000'000});
  EXPECT_THAT(notes_of(uri("tum", "?unit=ms")), IsEmpty());
  EXPECT_EQ(last_time(uri("tum", "?unit=s")), Timestamp{957'000'000'000});
  EXPECT_THAT(notes_of(uri("tum", "?unit=s")), ElementsAre(HasSubstr("33 s")));
  expect_open_error(uri("tum", "?unit=h"), ErrorCode::kUsage, "s, ms, us and ns");

  write_list("mav0/cam0/data.csv", 33333);
  expect_open_error(uri("euroc"), ErrorCode::kDamaged, "add unit=us");
  EXPECT_EQ(last_time(uri("euroc", "?unit=us")), Timestamp{966'657'000});
}

TEST_F(StampedFiles, AListOfWholeSecondsIsRefused) {
  write_list("rgb.txt", 1.0 / 30);
  expect_open_error(uri("tum"), ErrorCode::kDamaged, "which no camera has");
}

TEST_F(StampedFiles, StampsThatGoBackAreToldOnce) {
  write_image("0.png", 0);
  write_text("rgb.txt", "5 0.png\n5.1 0.png\n3 0.png\n3.1 0.png\n1 0.png\n");
  const auto source = open_source(uri("tum"));
  ASSERT_TRUE(source) << source.error().message;
  ASSERT_EQ((*source)->notes().size(), 1U);
  EXPECT_TRUE((*source)->notes()[0].is_warning);
  EXPECT_THAT((*source)->notes()[0].text, AllOf(HasSubstr("rgb.txt"), HasSubstr("2 of 5 stamps go back")));
  EXPECT_TRUE(take_all(**source).errors.empty());
}

TEST_F(StampedFiles, AFolderTakesItsTimesFromAList) {
  for (int i = 0; i < 3; ++i) write_image("p/" + std::to_string(i) + ".png", i);
  const auto times = [&](const std::string& content) {
    write_text("times.txt", content);
    return uri("images", "/p?times=" + (dir() / "times.txt").string());
  };
  const auto source = open_source(times("# of KITTI\n0.000000e+00\n1.036224e-01\n2.072870e-01\n"));
  ASSERT_TRUE(source) << source.error().message;
  const auto taken = take_all(**source);
  ASSERT_EQ(taken.frames.size(), 3U);
  EXPECT_EQ(number_of(taken.frames[2]), 2);
  EXPECT_EQ(taken.frames[2].time.nanoseconds, 207'287'000);
  EXPECT_EQ(last_time(times("0\n33\n66\n") + "&unit=ms"), Timestamp{66'000'000});
  expect_open_error(times("0\n1\n"), ErrorCode::kDamaged, "2 times, but");
  expect_open_error(times("0\n1\n2\n3\n"), ErrorCode::kDamaged, "3 images");
  expect_open_error(times("0\nnow\n"), ErrorCode::kDamaged, "times.txt:2: 'now' is not one time in seconds");
  expect_open_error(times("1403715273262\n"), ErrorCode::kDamaged, "add unit=ms");
  expect_open_error(times("0\n1\n2\n") + "&fps=3", ErrorCode::kUsage, "give one of them");
  expect_open_error(uri("images", "/p?times=/nowhere/t.txt"), ErrorCode::kNotFound, "/nowhere/t.txt");
}

TEST_F(StampedFiles, TheTimesOfAVideoAreLookedAt) {
  write_video("v.avi", 3);
  std::string times;
  for (int i = 0; i < 30; ++i) times += std::to_string(33 * i) + "\n";
  write_text("times.txt", times);
  const auto video = uri("video", "/v.avi?times=" + (dir() / "times.txt").string());
  expect_open_error(video, ErrorCode::kDamaged, "times.txt: the median step");
  const auto source = open_source(video + "&unit=ms");
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ(take_all(**source).frames.at(2).time, Timestamp{66'000'000});
}

}  // namespace
}  // namespace cairn
