#pragma once
#include <QVector>
#include <QWidget>
#include <vector>

class QwtPlot;
class QwtPlotCurve;

namespace phri_rviz
{
/// Forces and disagreement over the last 10 s of session time, in two plots with one time axis.
class PlotWidget : public QWidget
{
  Q_OBJECT

public:
  struct Sample
  {
    double time;              ///< of the session [s]; going back starts the plots anew
    double human_force;       ///< [N]
    double assistance_force;  ///< [N]
    double disagreement;      ///< [N]
  };

  explicit PlotWidget(QWidget* parent = nullptr);
  void add(const std::vector<Sample>& samples);
  void clear();

private:
  void draw();

  QVector<double> time_, human_, assistance_, disagreement_;
  QwtPlot *forces_, *disagreements_;
  QwtPlotCurve *human_curve_, *assistance_curve_, *disagreement_curve_;
};
}  // namespace phri_rviz
