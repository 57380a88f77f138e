#pragma once
/// The scenes of figures 4.4 to 4.10 with the settings of their captions and of sections 4.6.2 and 4.6.3. What the text
/// does not print is assumed and listed with the scene, so that a reproduced figure can state it.

#include <string>
#include <vector>

#include "phri_control/attitude.hpp"
#include "phri_control/planar_scene.hpp"

namespace phri_control
{
/// The attitude behind one panel of a figure. Sources are in the order of the scene's noise.
struct FigurePanel
{
  std::string panel;  ///< letter in the thesis
  std::string name;   ///< in words
  Attitude attitude;
};

struct ThesisScene
{
  std::string figure;
  PlanarScene scene;
  std::vector<FigurePanel> panels;
  std::vector<std::string> assumed;  ///< settings the text does not print
};

/// "4.4", "4.5", "4.6", "4.7", "4.8a" to "4.8d", "4.9", "4.10".
const std::vector<std::string>& thesisSceneNames();

/// Throws std::invalid_argument naming the known ones for any other name.
ThesisScene thesisScene(const std::string& figure);
}  // namespace phri_control
