// SPDX-License-Identifier: Apache-2.0
#include "client/app/unicode_fonts.h"

#include <fontconfig/fontconfig.h>

#include <map>
#include <opencv2/freetype.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "common/base/utf8.h"

namespace cairn {
namespace {

template <auto kDestroy>
struct Destroy {
  template <typename T>
  void operator()(T* object) const {
    kDestroy(object);
  }
};
using Pattern = std::unique_ptr<FcPattern, Destroy<FcPatternDestroy>>;
using Charset = std::unique_ptr<FcCharSet, Destroy<FcCharSetDestroy>>;

using FontFile = std::pair<std::string, int>;  ///< and the face's number in it

/// The font that fontconfig names first for these characters; null: there is no font at all.
Pattern match(const std::u32string& characters) {
  const Charset wanted(FcCharSetCreate());
  for (const char32_t character : characters) FcCharSetAddChar(wanted.get(), character);
  const Pattern pattern(FcNameParse(reinterpret_cast<const FcChar8*>("sans")));
  FcPatternAddCharSet(pattern.get(), FC_CHARSET, wanted.get());
  FcPatternAddBool(pattern.get(), FC_OUTLINE, FcTrue);
  FcPatternAddBool(pattern.get(), FC_COLOR, FcFalse);  // the freetype module draws outlines only
  FcConfigSubstitute(nullptr, pattern.get(), FcMatchPattern);
  FcDefaultSubstitute(pattern.get());
  FcResult result = FcResultNoMatch;
  return Pattern(FcFontMatch(nullptr, pattern.get(), &result));
}

struct Font {
  cv::Ptr<cv::freetype::FreeType2> face;  ///< null: it cannot be used
  Charset characters;

  [[nodiscard]] bool has(std::string_view letter) const {
    for (const char32_t character : code_points(letter)) {
      if (FcCharSetHasChar(characters.get(), character) != FcTrue) return false;
    }
    return true;
  }
};

Font open(const FcPattern& pattern, const FontFile& file) {
  Font font;
  FcCharSet* characters = nullptr;
  if (FcPatternGetCharSet(&pattern, FC_CHARSET, 0, &characters) != FcResultMatch) return font;
  font.characters.reset(FcCharSetCopy(characters));
  try {
    font.face = cv::freetype::createFreeType2();
    font.face->loadFontData(file.first, file.second);
  } catch (const cv::Exception&) {  // a damaged file
    font.face = nullptr;
  }
  return font;
}

}  // namespace

struct UnicodeFonts::Impl {
  /// A text as it is drawn.
  struct Line {
    Font* font = nullptr;
    std::string text;
  };

  std::map<FontFile, Font> fonts;
  std::map<std::string, Line> lines;  ///< what was found, as the same labels are drawn in each frame

  Font* font_for(const std::string& text) {
    const Pattern pattern = match(code_points(text));
    FcChar8* file = nullptr;
    if (pattern == nullptr || FcPatternGetString(pattern.get(), FC_FILE, 0, &file) != FcResultMatch)
      return nullptr;
    int number = 0;
    FcPatternGetInteger(pattern.get(), FC_INDEX, 0, &number);
    const FontFile key(reinterpret_cast<const char*>(file), number);
    auto known = fonts.find(key);
    if (known == fonts.end()) known = fonts.emplace(key, open(*pattern, key)).first;
    return known->second.face ? &known->second : nullptr;
  }

  const Line& line_of(const std::string& text) {
    constexpr size_t kMostLines = 4000;
    const auto known = lines.find(text);
    if (known != lines.end()) return known->second;
    if (lines.size() >= kMostLines) lines.clear();
    Line line{font_for(text), {}};
    if (line.font != nullptr) {
      for (const std::string_view letter : letters(text)) {
        if (line.font->has(letter))
          line.text += letter;
        else
          line.text += '?';
      }
    }
    return lines.emplace(text, std::move(line)).first->second;
  }
};

UnicodeFonts::UnicodeFonts() : impl_(std::make_unique<Impl>()) {}
UnicodeFonts::~UnicodeFonts() = default;

std::optional<cv::Size> UnicodeFonts::size(const std::string& text, int height) {
  const Impl::Line& line = impl_->line_of(text);
  if (line.font == nullptr) return std::nullopt;
  int below = 0;
  return line.font->face->getTextSize(line.text, height, cv::FILLED, &below);
}

bool UnicodeFonts::draw(const std::string& text, cv::Point baseline, int height, const cv::Scalar& ink,
                        cv::Mat* image) {
  const Impl::Line& line = impl_->line_of(text);
  if (line.font == nullptr) return false;
  line.font->face->putText(*image, line.text, baseline, height, ink, cv::FILLED, cv::LINE_AA, true);
  return true;
}

}  // namespace cairn
