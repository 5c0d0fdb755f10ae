// SPDX-License-Identifier: Apache-2.0
#include "client/capture/frame_source.h"

#include <gmock/gmock.h>

#include <cstdlib>

#include "client/capture/image_folder.h"
#include "client/capture/source_files_fixture.h"
#include "common/io/calibration.h"

namespace cairn {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
TEST_F(FrameSourceFiles, TumGivesTheListedFramesInTheirOrder) {
  write_image("images/a 0.png", 0);
  write_image("images/b.jpg", 1);
  write_image("c.pgm", 2);
  write_text(
      "rgb.txt",
      "# timestamp filename\n10.000000001 images/a 0.png\n10.5\timages/b.jpg\r\n2 c.pgm\n10 images/b.jpg\n");
  const auto source = open_source(uri("tum"));
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->frame_count(), 4u);
  EXPECT_FALSE((*source)->is_live());
  EXPECT_THAT((*source)->describe(), HasSubstr(dir().string()));
  const auto taken = take_all(**source);
  EXPECT_TRUE(taken.errors.empty());
  std::vector<int> numbers;
  std::vector<int64_t> times;
  for (size_t i = 0; i < taken.frames.size(); ++i) {
    EXPECT_EQ(taken.frames[i].index, i);
    numbers.push_back(number_of(taken.frames[i]));
    times.push_back(taken.frames[i].time.nanoseconds);
  }
  EXPECT_THAT(numbers, ElementsAre(0, 1, 2, 1));
  EXPECT_THAT(times, ElementsAre(10'000'000'001, 10'500'000'000, 2'000'000'000, 10'000'000'000));
}

TEST_F(FrameSourceFiles, ABadFrameIsNamedAndTheNextOneComes) {
  for (int i = 0; i < 5; ++i) write_image("images/" + std::to_string(i) + ".jpg", i);
  fs::resize_file(dir() / "images/1.jpg", fs::file_size(dir() / "images/1.jpg") / 2);
  fs::remove(dir() / "images/3.jpg");
  write_text("rgb.txt", "0 images/0.jpg\n1 images/1.jpg\n2 images/2.jpg\n3 images/3.jpg\n4 images/4.jpg\n");
  const auto source = open_source(uri("tum"));
  ASSERT_TRUE(source) << source.error().message;
  const auto taken = take_all(**source);
  EXPECT_THAT(taken.errors, ElementsAre(AllOf(HasSubstr("images/1.jpg"), HasSubstr("cut short")),
                                        AllOf(HasSubstr("images/3.jpg"), HasSubstr("no such file"))));
  ASSERT_EQ(taken.frames.size(), 3u);
  EXPECT_EQ(taken.frames[1].index, 2u);
  EXPECT_EQ(number_of(taken.frames[2]), 4);
  EXPECT_EQ(taken.frames[2].index, 4u);
}

TEST_F(FrameSourceFiles, TumListErrors) {
  expect_open_error(uri("tum"), ErrorCode::kNotFound, "rgb.txt: no such file; tum: needs this list");
  write_text("rgb.txt", "# nothing\n\n");
  expect_open_error(uri("tum"), ErrorCode::kDamaged, "lists no frame");
  write_text("rgb.txt", "# c\n0.1 a.png\nsoon b.png\n");
  expect_open_error(uri("tum"), ErrorCode::kDamaged, "rgb.txt:3:");
  write_text("rgb.txt", "0.1\n");
  expect_open_error(uri("tum"), ErrorCode::kDamaged, "rgb.txt:1:");
  expect_open_error(uri("tum", "?fps=3"), ErrorCode::kUsage, "it takes unit");
}

TEST_F(FrameSourceFiles, ListsAreReadAsWindowsAndSpreadsheetsWriteThem) {
  for (int i = 0; i < 3; ++i) {
    write_image("rgb/" + std::to_string(i) + ".png", i);
    write_image("mav0/cam0/data/" + std::to_string(i) + ".png", i);
  }
  const std::string mark = "\xef\xbb\xbf";
  for (const std::string& list : {mark + "# timestamp filename\r\n0.1 rgb/1.png\r\n0.2 rgb/2.png\r\n",
                                  mark + "0.1 rgb/1.png\n0.2 rgb/2.png\n",
                                  std::string("timestamp filename\n0.1 rgb\\1.png\n0.2 rgb\\2.png\n"),
                                  std::string("# c\r0.1 rgb/1.png\r0.2 rgb/2.png\r")}) {
    write_text("rgb.txt", list);
    const auto source = open_source(uri("tum"));
    ASSERT_TRUE(source) << source.error().message << list;
    const auto taken = take_all(**source);
    EXPECT_TRUE(taken.errors.empty()) << list;
    ASSERT_EQ(taken.frames.size(), 2u) << list;
    EXPECT_EQ(number_of(taken.frames[1]), 2);
  }
  for (const std::string& list :
       {mark + "#timestamp [ns],filename\n1,1.png\n2,2.png\n",
        std::string("timestamp,filename\n1,1.png\n2,.\\2.png\n"), std::string("1,1.png\r2,2.png")}) {
    write_text("mav0/cam0/data.csv", list);
    const auto source = open_source(uri("euroc"));
    ASSERT_TRUE(source) << source.error().message << list;
    EXPECT_EQ(number_of(take_all(**source).frames.at(1)), 2) << list;
  }
  const std::string wide("\xff\xfe\x30\0", 4);
  write_text("rgb.txt", wide);
  expect_open_error(uri("tum"), ErrorCode::kDamaged, "rgb.txt: is UTF-16 text");
  write_text("mav0/cam0/data.csv", wide);
  expect_open_error(uri("euroc"), ErrorCode::kDamaged, "data.csv: is UTF-16 text");
}

TEST_F(FrameSourceFiles, EurocGivesTheListedFramesAndItsCalibration) {
  for (const std::string at : {"mav0/cam0/", "mav0/cam1/"}) {
    for (int i = 0; i < 2; ++i)
      write_image(at + "data/" + std::to_string(i) + ".png", i + (at == "mav0/cam1/" ? 5 : 0));
    write_text(at + "data.csv",
               "#timestamp [ns],filename\r\n1403715273262142976,1.png\r\n1403715273312143104,0.png\r\n");
  }
  const auto source = open_source(uri("euroc"));
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->frame_count(), 2u);
  EXPECT_EQ((*source)->image_size(), (ImageSize{kWidth, kHeight}));
  const auto taken = take_all(**source);
  EXPECT_TRUE(taken.errors.empty());
  ASSERT_EQ(taken.frames.size(), 2u);
  EXPECT_EQ(taken.frames[0].time.nanoseconds, 1403715273262142976);
  EXPECT_EQ(taken.frames[1].time.nanoseconds, 1403715273312143104);
  EXPECT_EQ(number_of(taken.frames[0]), 1);
  EXPECT_EQ(number_of(take_all(**open_source(uri("euroc", "?camera=cam1"))).frames.at(0)), 6);
  EXPECT_EQ(number_of(take_all(**open_source(uri("euroc", "/mav0"))).frames.at(0)), 1);
  EXPECT_FALSE(find_calibration(uri("euroc")));
  write_text("mav0/cam0/sensor.yaml", "");
  EXPECT_EQ(find_calibration(uri("euroc")), dir() / "mav0/cam0/sensor.yaml");
}

TEST_F(FrameSourceFiles, EurocErrors) {
  expect_open_error(uri("euroc"), ErrorCode::kNotFound, "data.csv: no such file; euroc: needs");
  fs::create_directories(dir() / "mav0/cam0");
  write_text("mav0/cam0/data.csv", "#timestamp [ns],filename\n");
  expect_open_error(uri("euroc"), ErrorCode::kDamaged, "lists no frame");
  for (const char* row : {"1.5,a.png", "12a,a.png", "12,", "12", ",a.png"}) {
    write_text("mav0/cam0/data.csv", std::string("#c\n1,a.png\n") + row + "\n");
    expect_open_error(uri("euroc"), ErrorCode::kDamaged, "data.csv:3: not a row");
  }
  expect_open_error(uri("euroc", "?cam=1"), ErrorCode::kUsage, "it takes camera, unit");
}

TEST_F(FrameSourceFiles, ImagesComeInNaturalOrderAtTheirRate) {
  write_image("frame10.png", 3);
  write_image("frame9.JPG", 2);
  write_image("frame1.jpeg", 0);
  write_image("frame02.pgm", 1);
  write_text("notes.txt", "not an image");
  const auto source = open_source(uri("images", "?fps=30"));
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->frame_count(), 4u);
  const auto taken = take_all(**source);
  ASSERT_EQ(taken.frames.size(), 4u);
  const std::vector<int64_t> times = {0, 33'333'333, 66'666'667, 100'000'000};
  for (size_t i = 0; i < times.size(); ++i) {
    EXPECT_EQ(number_of(taken.frames[i]), static_cast<int>(i));
    EXPECT_EQ(taken.frames[i].time.nanoseconds, times[i]);
  }
  expect_open_error(uri("images", "?fps=0"), ErrorCode::kUsage, "fps=0");
  expect_open_error(uri("images", "?rate=3"), ErrorCode::kUsage, "it takes fps, times, unit, match");
  expect_open_error(uri("images", "/none"), ErrorCode::kNotFound, "no such directory");
  fs::create_directory(dir() / "empty");
  expect_open_error(uri("images", "/empty"), ErrorCode::kNotFound, "no png");
  expect_open_error(uri("images", "/notes.txt"), ErrorCode::kIo, "cannot be listed");
}

TEST(NaturalOrder, IsAStrictTotalOrder) {
  const std::vector<std::string> names = {"",  "1",  "01",  "2",  "10",  "010",   "10a",
                                          "a", "a1", "a1b", "a2", "a10", "a10b2", "b"};
  for (const auto& a : names) {
    EXPECT_FALSE(natural_less(a, a)) << a;
    for (const auto& b : names) {
      EXPECT_EQ(natural_less(a, b), a != b && !natural_less(b, a)) << a << " " << b;
      for (const auto& c : names) {
        EXPECT_TRUE(!natural_less(a, b) || !natural_less(b, c) || natural_less(a, c))
            << a << " " << b << " " << c;
      }
    }
  }
  EXPECT_TRUE(natural_less("frame9", "frame10"));
  EXPECT_TRUE(natural_less("f99999999999999999999998", "f99999999999999999999999"));
}

TEST_F(FrameSourceFiles, VideoTakesItsTimesFromTheList) {
  write_video("v1.avi", 6);
  write_text("times.txt",
             "\xef\xbb\xbf"
             "timestamp\n100.1\n100.2\n100.35\n100.4\n100.5\n100.6\n");
  const auto source = open_source(uri("video", "/v1.avi?times=" + (dir() / "times.txt").string()));
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->frame_count(), 6u);
  EXPECT_EQ((*source)->image_size(), (ImageSize{kWidth, kHeight}));
  const auto taken = take_all(**source);
  EXPECT_TRUE(taken.errors.empty());
  ASSERT_EQ(taken.frames.size(), 6u);
  EXPECT_EQ(taken.frames[2].time.nanoseconds, 100'350'000'000);
  for (int i = 0; i < 6; ++i) EXPECT_EQ(number_of(taken.frames[static_cast<size_t>(i)]), i);
}

TEST_F(FrameSourceFiles, StampsOfAContainerThatNoCameraHasAreTold) {
  write_video("v.mp4", 12, 0.03);
  const auto source = open_source(uri("video", "/v.mp4"));
  ASSERT_TRUE(source) << source.error().message;
  const auto notes = (*source)->notes();
  ASSERT_FALSE(notes.empty());
  EXPECT_TRUE(notes[0].is_warning);
  EXPECT_THAT(notes[0].text, AllOf(HasSubstr("33.3 s"), HasSubstr("milliseconds"), HasSubstr("times=FILE")));
  write_text("times.txt", "0\n0.1\n0.2\n0.3\n0.4\n0.5\n0.6\n0.7\n0.8\n0.9\n1.0\n1.1\n");
  const auto listed = open_source(uri("video", "/v.mp4?times=" + (dir() / "times.txt").string()));
  ASSERT_TRUE(listed) << listed.error().message;
  EXPECT_TRUE((*listed)->notes().empty());
  write_video("ordinary.mp4", 12);
  EXPECT_TRUE((*open_source(uri("video", "/ordinary.mp4")))->notes().empty());
}

TEST_F(FrameSourceFiles, VideoWithoutTimesUsesTheContainers) {
  write_video("v.avi", 5);
  const auto source = open_source(uri("video", "/v.avi"));
  ASSERT_TRUE(source) << source.error().message;
  const auto taken = take_all(**source);
  ASSERT_EQ(taken.frames.size(), 5u);
  for (size_t i = 1; i < 5; ++i) {
    EXPECT_NEAR(seconds_between(taken.frames[i].time, taken.frames[i - 1].time), 0.05, 1e-3) << i;
  }
}

TEST_F(FrameSourceFiles, VideoAndTimesThatDoNotAgree) {
  write_video("v.avi", 4);
  write_text("short.txt", "1\n2\n3\n");
  write_text("long.txt", "1\n2\n3\n4\n5\n");
  auto source = open_source(uri("video", "/v.avi?times=" + (dir() / "short.txt").string()));
  ASSERT_TRUE(source) << source.error().message;
  auto taken = take_all(**source);
  EXPECT_EQ(taken.frames.size(), 3u);
  EXPECT_THAT(taken.errors, ElementsAre(AllOf(HasSubstr("short.txt"), HasSubstr("3 times"))));
  source = open_source(uri("video", "/v.avi?times=" + (dir() / "long.txt").string()));
  ASSERT_TRUE(source) << source.error().message;
  taken = take_all(**source);
  EXPECT_EQ(taken.frames.size(), 4u);
  EXPECT_THAT(taken.errors, ElementsAre(AllOf(HasSubstr("v.avi"), HasSubstr("frame 4 of the 5"))));
}

TEST_F(FrameSourceFiles, VideoCutShort) {
  constexpr int kFrames = 40;
  write_video("v.avi", kFrames);
  const auto file = dir() / "v.avi";
  std::filesystem::resize_file(file, std::filesystem::file_size(file) / 2);
  const auto source = open_source(uri("video", "/v.avi"));
  ASSERT_TRUE(source) << source.error().message;
  const auto taken = take_all(**source);
  EXPECT_LT(taken.frames.size(), size_t{kFrames});
  EXPECT_THAT(taken.errors,
              ElementsAre(AllOf(HasSubstr("v.avi"), HasSubstr("of 40"), HasSubstr("cut short"))));
}

TEST_F(FrameSourceFiles, VideoErrors) {
  expect_open_error(uri("video", "/none.mp4"), ErrorCode::kNotFound, "none.mp4: no such video");
  write_text("not.mp4", "this is no video");
  expect_open_error(uri("video", "/not.mp4"), ErrorCode::kDamaged, "not.mp4");
  write_video("v.avi", 2);
  expect_open_error(uri("video", "/v.avi?times=/nowhere/times.txt"), ErrorCode::kNotFound,
                    "/nowhere/times.txt");
  write_text("bad.txt", "1.0\n# c\nnow\n");
  expect_open_error(uri("video", "/v.avi?times=" + (dir() / "bad.txt").string()), ErrorCode::kDamaged,
                    "bad.txt:3: 'now'");
  write_text("empty.txt", "\n");
  expect_open_error(uri("video", "/v.avi?times=" + (dir() / "empty.txt").string()), ErrorCode::kDamaged,
                    "no time");
  expect_open_error(uri("video", "/v.avi?fps=3"), ErrorCode::kUsage, "it takes times, unit");
}

TEST_F(FrameSourceFiles, CameraErrors) {
  expect_open_error(uri("v4l2", "/video99"), ErrorCode::kNotFound, "no such camera");
  expect_open_error("v4l2:/dev/null", ErrorCode::kIo, "/dev/null: is not a camera");
  write_text("video0", "");
  expect_open_error(uri("v4l2", "/video0"), ErrorCode::kIo, "not a device");
  expect_open_error("v4l2:/dev/null?size=640", ErrorCode::kUsage, "size=640");
  expect_open_error("v4l2:/dev/null?size=0x480", ErrorCode::kUsage, "size=0x480");
  expect_open_error("v4l2:/dev/null?fps=x", ErrorCode::kUsage, "fps=x");
  expect_open_error("v4l2:/dev/null?gain=1", ErrorCode::kUsage, "size, fps");
}

TEST_F(FrameSourceFiles, UnknownSchemeListsTheOthers) {
  expect_open_error("kitti:/x", ErrorCode::kUsage, "tum:, euroc:, images:, video:, v4l2:");
  expect_open_error("/dev/video0", ErrorCode::kUsage, "scheme:path");
}

TEST_F(FrameSourceFiles, CalibrationLiesBesideTheImages) {
  write_image("images/0.png", 0);
  const auto video = uri("video", "/v.avi?times=x");
  for (const auto& source : {uri("tum"), uri("images", "/images"), video})
    EXPECT_FALSE(find_calibration(source)) << source;
  write_text("camera.txt", "640 480 525 525 320 240\n");
  for (const auto& source : {uri("tum"), uri("images", "/images"), uri("images"), video}) {
    EXPECT_EQ(find_calibration(source), dir() / "camera.txt") << source;
  }
  write_text("images/camera.txt", "640 480 525 525 320 240\n");
  EXPECT_EQ(find_calibration(uri("images", "/images")), dir() / "images/camera.txt");
  EXPECT_FALSE(find_calibration("v4l2:/dev/video0"));
  EXPECT_FALSE(find_calibration("nonsense"));
}

/// Real recordings, where there are some: all open, their first frames decode and their size is that of
/// camera.txt.
TEST(Recordings, OpenAndDecode) {
  const char* data = std::getenv("CAIRN_DATA");
  if (data == nullptr) GTEST_SKIP() << "CAIRN_DATA is not set";
  int sequences = 0;
  for (const auto& entry : fs::directory_iterator(data)) {
    const auto& dir = entry.path();
    std::string uri;
    if (fs::exists(dir / "rgb.txt")) uri = "tum:" + dir.string();
    if (fs::exists(dir / "video.mp4")) {
      uri = "video:" + (dir / "video.mp4").string() + "?times=" + (dir / "times.txt").string();
    }
    if (uri.empty()) continue;
    ++sequences;
    const auto source = open_source(uri);
    ASSERT_TRUE(source) << source.error().message;
    EXPECT_EQ(find_calibration(uri).has_value(), fs::exists(dir / "camera.txt"));
    for (size_t i = 0; i < std::min<size_t>(10, (*source)->frame_count().value()); ++i) {
      const auto frame = (*source)->next();
      ASSERT_TRUE(frame) << frame.error().message;
      ASSERT_TRUE(frame->has_value()) << uri;
      if (!find_calibration(uri)) continue;
      const auto calibration = read_calibration(*find_calibration(uri));
      ASSERT_TRUE(calibration) << calibration.error().message;
      EXPECT_EQ((*frame)->image->width(), calibration->width) << uri;
      EXPECT_EQ((*frame)->image->height(), calibration->height) << uri;
    }
  }
  EXPECT_GT(sequences, 0) << "nothing in " << data;
}

}  // namespace
}  // namespace cairn
