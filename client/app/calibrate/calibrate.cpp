// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/calibrate.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "client/app/calibrate/view_picker.h"
#include "client/app/calibration_saver.h"
#include "client/app/narrator.h"
#include "common/base/stream_writer.h"
#include "common/io/calibration.h"
#include "common/io/distinct_files.h"

namespace cairn {
namespace {

constexpr double kLookEverySeconds = 0.2;
constexpr size_t kTrySolveEvery = 5;  ///< views kept, with a live camera
constexpr size_t kFirstTry = 10;

/// Images in, views out.
class Collector {
 public:
  Collector(const Board& board, CameraModel model, const Logger& log)
      : board_(board), model_(model), log_(log) {}

  /// Looks at an image unless the last one is too near in time.
  Status look(const Frame& frame) {
    const ImageSize size{frame.image->width(), frame.image->height()};
    if (!picker_) {
      size_ = size;
      picker_.emplace(size);
    }
    if (size != size_) {
      return fail(ErrorCode::kDamaged,
                  fmt::format("image {} is {}x{}, the ones before were {}x{}", frame.index, size.width,
                              size.height, size_.width, size_.height));
    }
    if (last_ && std::abs(seconds_between(frame.time, *last_)) < kLookEverySeconds) return {};
    last_ = frame.time;
    ++report_.images;
    const auto view = board_.find(*frame.image);
    if (!view) return {};
    ++report_.found;
    const double width = edge_width(*frame.image, *view);
    const auto outcome = picker_->offer(*view, width);
    blurred_ += outcome == ViewPicker::Outcome::kBlurred ? 1 : 0;
    if (outcome == ViewPicker::Outcome::kKept) {
      log_->info("view {}: {} points, edges {:.1f} px wide", picker_->size(), view->size(), width);
    }
    return {};
  }

  [[nodiscard]] size_t views() const { return picker_ ? picker_->size() : 0; }

  Result<CalibrateReport> solve() {
    if (report_.images == 0) return fail(ErrorCode::kDegenerate, "the source gave no image");
    if (views() < 3) {
      return fail(
          ErrorCode::kDegenerate,
          fmt::format("{} images, {} with the {}, {} of them blurred: {} different sharp views, 3 are the "
                      "least; hold the whole board into the light and check that it is what was printed",
                      report_.images, report_.found, board_.describe(), blurred_, views()));
    }
    const auto views = picker_->views();
    auto calibration = calibrate(model_, size_, views);
    if (!calibration) return tl::unexpected(calibration.error());
    report_.calibration = std::move(*calibration);
    report_.verdict = judge(report_.calibration, views);
    return report_;
  }

 private:
  const Board& board_;
  CameraModel model_;
  Logger log_;
  ImageSize size_;
  std::optional<ViewPicker> picker_;
  std::optional<Timestamp> last_;
  int blurred_ = 0;
  CalibrateReport report_;
};

/// Solves whenever kTrySolveEvery more views have come, and tells the person at a live camera what would make
/// the calibration better. Whether it is good enough.
bool good_enough(Collector& collector, size_t* next_try, const Logger& log) {
  if (collector.views() < *next_try) return false;
  *next_try = collector.views() + kTrySolveEvery;
  const auto report = collector.solve();
  if (!report) return false;
  for (const auto& advice : report->verdict.advice) log->info("{}", advice);
  return report->verdict.grade == Grade::kGood;
}

void tell(const CalibrateReport& report, const Logger& log) {
  const auto& values = report.calibration.parameters.values;
  const auto& sigma = report.calibration.sigma;
  const auto& verdict = report.verdict;
  log->info("{} images, {} with the board, {} views count", report.images, report.found, verdict.views);
  log->info("camera: {}", describe_camera(report.calibration.parameters));
  log->info("fx {:.2f} +- {:.2f}  fy {:.2f} +- {:.2f}  cx {:.2f} +- {:.2f}  cy {:.2f} +- {:.2f}", values[0],
            sigma[0], values[1], sigma[1], values[2], sigma[2], values[3], sigma[3]);
  log->info(
      "{}: {:.5f} {:.5f} {:.5f} {:.5f}",
      report.calibration.parameters.model == CameraModel::kPinholeRadtan ? "k1 k2 p1 p2" : "k1 k2 k3 k4",
      values[4], values[5], values[6], values[7]);
  log->info(
      "rms {:.3f} px; focal length within {:.2f} %; {:.0f} % of the image covered; tilts up to {:.0f} "
      "degrees",
      report.calibration.rms, 100 * verdict.focal_sigma, 100 * verdict.coverage,
      verdict.largest_tilt * 180 / std::numbers::pi);
}

std::string comment_of(const CalibrateReport& report, const CalibrateOptions& options, const Board& board) {
  const auto& sigma = report.calibration.sigma;
  return fmt::format(
      "cairn-track calibrate, {} in {}\n{}: {} views, rms {:.3f} px, {:.0f} % of the image covered\n"
      "sigma of fx fy cx cy [px]: {:.3f} {:.3f} {:.3f} {:.3f}",
      board.describe(), options.source, name_of(report.verdict.grade), report.verdict.views,
      report.calibration.rms, 100 * report.verdict.coverage, sigma[0], sigma[1], sigma[2], sigma[3]);
}

int report_error(const Error& error, const Logger& log) {
  log->error("{}", error.message);
  return exit_code(error.code);
}

/// Minutes before a camera are not to be lost to a file that could be written when they began.
int print_instead(const std::string& yaml, const Error& error, const Logger& log) {
  const auto output = StreamWriter::of_descriptor(STDOUT_FILENO, "standard output");
  if (!output->write(yaml) || !output->finish()) return report_error(error, log);
  return report_error(
      {error.code, error.message + "; the calibration is on stdout instead: save it from there"}, log);
}

int draw(const CalibrateOptions& options, const Logger& log) {
  constexpr int kSquarePixels = 100;
  const auto image = draw_board(options.board, kSquarePixels);
  if (!image) return report_error(image.error(), log);
  const cv::Mat pixels(image->height(), image->width(), CV_8U, const_cast<uint8_t*>(image->row(0)),
                       static_cast<size_t>(image->stride()));
  std::vector<uint8_t> bytes;
  try {
    cv::imencode(options.draw->extension().string(), pixels, bytes);
  } catch (const cv::Exception&) {
    bytes.clear();
  }
  if (bytes.empty())
    return report_error({ErrorCode::kIo, options.draw->string() + ": cannot be written; try .png"}, log);
  if (const auto written = write_stream(*options.draw, {bytes.begin(), bytes.end()}); !written)
    return report_error(written.error(), log);
  log->info("{}: print it, glue it to something flat and stiff, and leave a white margin",
            options.draw->string());
  return 0;
}

}  // namespace

Result<CalibrateReport> calibrate_from(FrameSource& source, const Board& board, CameraModel model,
                                       const Logger& log, const std::function<bool()>& stop_requested) {
  Collector collector(board, model, log);
  std::optional<Error> first_error;
  size_t next_try = kFirstTry;
  bool any_image = false;
  while (!stop_requested()) {
    auto frame = source.next();
    if (!frame) {
      log->warn("{}", frame.error().message);
      if (!first_error) first_error = frame.error();
      continue;
    }
    if (!*frame) break;
    any_image = true;
    if (auto status = collector.look(**frame); !status) return tl::unexpected(status.error());
    if (source.is_live() && good_enough(collector, &next_try, log)) break;
  }
  if (!any_image && first_error) return tl::unexpected(*first_error);
  return collector.solve();
}

int run_calibrate(const CalibrateOptions& options, const Logger& log,
                  const std::function<bool()>& stop_requested) {
  if (options.draw) return draw(options, log);
  const auto board = make_board(options.board);
  if (!board) return report_error(board.error(), log);
  std::vector<NamedFile> read;
  for (const auto& path : source_files(options.source)) read.push_back({"--source", path});
  if (!options.board.tags.empty()) read.push_back({"--tags", options.board.tags});
  if (const auto distinct = check_distinct({{"--out", options.out}}, read); !distinct)
    return report_error(distinct.error(), log);
  if (const auto writable = check_writable(options.out); !writable) {
    return report_error({writable.error().code, writable.error().message + "; pass another --out FILE"}, log);
  }
  auto source = open_source(options.source);
  if (!source) return report_error(source.error(), log);
  tell_notes((**source).notes(), log);
  log->info("{}; looking for a {}", (*source)->describe(), (*board)->describe());
  if ((*source)->is_live()) log->info("move the board through the whole image, near and tilted; Ctrl-C ends");
  const auto report = calibrate_from(**source, **board, options.model, log, stop_requested);
  if (!report) {
    log->error("{}", report.error().message);
    return report.error().code == ErrorCode::kDegenerate ? 1 : exit_code(report.error().code);
  }
  tell(*report, log);
  for (const auto& advice : report->verdict.advice) log->info("{}", advice);
  if (report->verdict.grade == Grade::kPoor) {
    log->error("poor: not written; follow the advice above");
    return 1;
  }
  const std::string comment = comment_of(*report, options, **board);
  const auto& parameters = report->calibration.parameters;
  if (const auto written = write_calibration_kalibr(options.out, parameters, comment); !written) {
    return print_instead(format_calibration_kalibr(parameters, comment).value_or(""), written.error(), log);
  }
  log->info("{}: written to {}", name_of(report->verdict.grade), options.out.string());
  return 0;
}

}  // namespace cairn
