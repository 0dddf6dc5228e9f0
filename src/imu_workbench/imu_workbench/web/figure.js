// SPDX-License-Identifier: Apache-2.0
// A Plotly figure. It is drawn when it comes near the visible part of the page: the page is ready as
// soon as the visible figures are, and changing a figure that is scrolled away costs nothing.
const EVENTS = ['click', 'hover', 'unhover', 'relayout', 'afterplot'];

// What is sent to the server: the points without their links to the data of the whole figure.
const told = (event) => ({
  ...event,
  points: event?.points?.map((p) => ({ ...p, fullData: undefined, xaxis: undefined, yaxis: undefined })),
  xaxes: undefined,
  yaxes: undefined,
});

export default {
  template: '<div></div>',
  props: { options: Object },
  mounted() {
    this.near = false;
    this.drawn = null;
    this.look = null;
    this.watching = new IntersectionObserver((entries) => {
      this.near = entries.at(-1).isIntersecting;
      this.draw();
    }, { rootMargin: '25% 0px' });
    this.sizing = new ResizeObserver(() => this.draw());
    this.watching.observe(this.$el);
    this.sizing.observe(this.$el);
  },
  unmounted() {
    this.watching.disconnect();
    this.sizing.disconnect();
  },
  methods: {
    update() {
      this.drawn = null;
      this.draw();
    },
    async draw() {
      const { Plotly } = await import('nicegui-plotly');
      const width = this.$el.clientWidth;
      if (!this.near || !width) return;
      if (this.drawn) {
        if (this.width !== width) Plotly.Plots.resize(this.$el);
        this.width = width;
        return;
      }
      const { data, layout, config } = this.drawn = this.options;
      this.width = width;
      const look = JSON.stringify(config);
      if (this.look === look) {
        Plotly.react(this.$el, data, layout, config);
        return;
      }
      this.look = look;
      Plotly.newPlot(this.$el, data, layout, config);
      for (const name of EVENTS) {
        this.$el.on(`plotly_${name}`, (event) => this.$emit(`plotly_${name}`, told(event)));
      }
    },
  },
};
