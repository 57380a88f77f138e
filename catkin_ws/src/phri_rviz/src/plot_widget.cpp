#include "plot_widget.hpp"

#include <qwt_legend.h>
#include <qwt_plot.h>
#include <qwt_plot_canvas.h>
#include <qwt_plot_curve.h>
#include <qwt_plot_grid.h>
#include <qwt_plot_layout.h>
#include <qwt_scale_draw.h>
#include <qwt_scale_widget.h>

#include <QVBoxLayout>
#include <algorithm>
#include <cmath>

namespace phri_rviz
{
namespace
{
constexpr double kSpan = 10;       // [s] shown
constexpr double kLeastRange = 2;  // [N] so that noise does not fill the plot
constexpr int kAxisWidth = 34;     // [px] of both force axes: their zeros stand above each other
constexpr int kOverhang = 22;  // [px] of the outermost time labels, in both plots: their times stand above each other
constexpr int kMostPoints = 2000;  // twice what 100 Hz bring
// as the arrows of the 3-D view
const QColor kHuman(31, 107, 204), kAssistance(230, 115, 13), kDisagreement(191, 31, 51);

QwtPlot* makePlot(const QString& name, const QString& unit_axis, const QString& time_axis)
{
  auto* plot = new QwtPlot;
  plot->setObjectName(name);
  plot->setCanvasBackground(Qt::white);
  plot->setAutoReplot(false);
  plot->plotLayout()->setAlignCanvasToScales(true);
  auto* canvas = qobject_cast<QwtPlotCanvas*>(plot->canvas());
  canvas->setFrameStyle(QFrame::NoFrame);
  for (const int axis : { int(QwtPlot::yLeft), int(QwtPlot::xBottom) })
  {
    QFont font = plot->font();
    font.setPointSizeF(font.pointSizeF() * 0.85);
    plot->setAxisFont(axis, font);
    QwtText title(axis == QwtPlot::yLeft ? unit_axis : time_axis);
    title.setFont(font);
    plot->setAxisTitle(axis, title);
    plot->axisWidget(axis)->setMargin(2);
    plot->axisWidget(axis)->setSpacing(1);
  }
  plot->axisScaleDraw(QwtPlot::yLeft)->setMinimumExtent(kAxisWidth);
  plot->axisWidget(QwtPlot::xBottom)->setMinBorderDist(kOverhang, kOverhang);
  plot->setAxisMaxMajor(QwtPlot::yLeft, 4);
  plot->setAxisMaxMajor(QwtPlot::xBottom, 6);
  plot->setAxisMaxMinor(QwtPlot::yLeft, 0);
  plot->setAxisMaxMinor(QwtPlot::xBottom, 0);
  plot->setAxisScale(QwtPlot::xBottom, 0, kSpan);
  plot->setAxisScale(QwtPlot::yLeft, 0, kLeastRange);

  auto* grid = new QwtPlotGrid;
  grid->setPen(QColor(225, 227, 230), 0.0, Qt::SolidLine);
  grid->attach(plot);
  // above the plot: inside it would hide curves
  auto* legend = new QwtLegend;
  legend->setObjectName(name + "Legend");
  legend->contentsWidget()->layout()->setAlignment(Qt::AlignLeft);
  plot->insertLegend(legend, QwtPlot::TopLegend);
  return plot;
}

QwtPlotCurve* makeCurve(QwtPlot* plot, const QString& name, const QColor& color)
{
  auto* curve = new QwtPlotCurve(name);
  curve->setPen(color, 1.3);
  curve->setRenderHint(QwtPlotItem::RenderAntialiased);
  curve->setLegendAttribute(QwtPlotCurve::LegendShowLine);
  curve->setLegendIconSize(QSize(16, 8));
  curve->attach(plot);
  return curve;
}

/// The upper end of an axis: 1, 2 or 5 times a power of ten, so that it does not change with every sample.
double niceAbove(double value)
{
  value = std::max(value, kLeastRange);
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : { 1.0, 2.0, 5.0 })
    if (value <= factor * power)
      return factor * power;
  return 10 * power;
}

double largest(const QVector<double>& values)
{
  double result = 0;
  for (const double value : values)
    if (std::isfinite(value))
      result = std::max(result, value);
  return result;
}
}  // namespace

PlotWidget::PlotWidget(QWidget* parent)
  : QWidget(parent),
    forces_(makePlot("forcePlot", "force [N]", "")),
    disagreements_(makePlot("disagreementPlot", "force [N]", "session time [s]")),
    human_curve_(makeCurve(forces_, "human", kHuman)),
    assistance_curve_(makeCurve(forces_, "assistance", kAssistance)),
    disagreement_curve_(makeCurve(disagreements_, "disagreement", kDisagreement))
{
  auto* layout = new QVBoxLayout(this);
  layout->setContentsMargins(0, 0, 0, 0);
  layout->setSpacing(2);
  forces_->axisScaleDraw(QwtPlot::xBottom)->enableComponent(QwtScaleDraw::Labels, false);  // the other plot's
  layout->addWidget(forces_, 5);
  layout->addWidget(disagreements_, 4);
  forces_->setMinimumHeight(120);
  disagreements_->setMinimumHeight(125);
}

void PlotWidget::add(const std::vector<Sample>& samples)
{
  if (samples.empty())
    return;
  for (const Sample& sample : samples)
  {
    if (!time_.isEmpty() && sample.time < time_.last())
      clear();
    time_.push_back(sample.time);
    human_.push_back(sample.human_force);
    assistance_.push_back(sample.assistance_force);
    disagreement_.push_back(sample.disagreement);
  }
  const auto first = std::lower_bound(time_.begin(), time_.end(), time_.last() - kSpan);
  const int old = std::max(int(first - time_.begin()), int(time_.size()) - kMostPoints);
  for (QVector<double>* values : { &time_, &human_, &assistance_, &disagreement_ })
    values->remove(0, old);
  draw();
}

void PlotWidget::clear()
{
  for (QVector<double>* values : { &time_, &human_, &assistance_, &disagreement_ })
    values->clear();
}

void PlotWidget::draw()
{
  human_curve_->setSamples(time_, human_);
  assistance_curve_->setSamples(time_, assistance_);
  disagreement_curve_->setSamples(time_, disagreement_);
  forces_->setAxisScale(QwtPlot::yLeft, 0, niceAbove(std::max(largest(human_), largest(assistance_))));
  disagreements_->setAxisScale(QwtPlot::yLeft, 0, niceAbove(largest(disagreement_)));
  const double end = std::max(kSpan, time_.isEmpty() ? 0.0 : time_.last());
  for (QwtPlot* plot : { forces_, disagreements_ })
  {
    plot->setAxisScale(QwtPlot::xBottom, end - kSpan, end);
    plot->replot();
  }
}
}  // namespace phri_rviz
