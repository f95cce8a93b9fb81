import js from "@eslint/js";
import globals from "globals";

export default [
  { ignores: ["viz/web/vendor/"] },
  js.configs.recommended,
  {
    languageOptions: { globals: { ...globals.browser, MeshCat: "readonly", uPlot: "readonly" } },
    rules: {
      "no-var": "error", "prefer-const": ["error", { destructuring: "all" }], eqeqeq: "error", "no-shadow": "error", "no-use-before-define": ["error", { functions: false, classes: false, variables: false }],
    },
  },
];
